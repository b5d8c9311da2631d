"""The 3D view: the numbers it draws from, and the canvas with its controls. `space.js` does the drawing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import Results, Trajectory
from pipeline.report.charts.ellipses import enlargement
from pipeline.report.data import participants
from pipeline.report.data.participants import CameraPath
from pipeline.report.data.visibility import times_seen
from pipeline.report.text.markup import Html, data_script, joined, tag
from pipeline.report.views.films import films_figure

POINTS, CAMERA_POINTS, RINGS = 6000, 400, 90
ABOUT = (
    "Three-dimensional view of cameras and trajectories. Drag to turn, shift-drag to move, scroll (after a click) or "
    "pinch to zoom; arrow keys turn, plus and minus zoom, 0 resets."
)


def space_figure(results: Results) -> Html:
    """Canvas, buttons and the slider of time that the map and every time chart follow."""
    start, end = participants.time_span(results)
    canvas = tag("canvas", ABOUT, id="space", tabindex=0, role="img", aria_label=ABOUT)
    boxes = [_switch("uncertainty", "uncertainty"), _switch("sights", "lines of sight")]
    boxes += [_switch("truth", "truth")] if results.truth is not None else []
    buttons = [tag("button", words, type="button", data_view=view) for view, words in _VIEWS]
    slider = tag(
        "input", type="range", id="moment", min=f"{start:.3f}", max=f"{end:.3f}", value=f"{start:.3f}",
        step=f"{(end - start) / 1000:.6f}", aria_label="Common time in seconds",
    )  # fmt: skip
    play = tag("button", "\u25b6", type="button", id="play", aria_label="Play")
    clock = tag("div", play, slider, tag("output", "", id="moment-words", for_="moment"), class_="clock")
    hint = tag(
        "figcaption",
        "Drag turns, shift-drag moves, scroll after a click zooms; arrow keys, +, \u2212 and 0 do the same. ",
        tag("span", "", id="space-words"),
        participants.thinning_words(results, _limit(results)),
    )
    return tag("figure", tag("div", *buttons, *boxes, class_="controls"), canvas, clock, hint, class_="space")


_VIEWS = (("all", "everything"), ("targets", "targets"), ("top", "from above"), ("side", "from the south"))


def _switch(name: str, words: str) -> Html:
    return tag("label", tag("input", type="checkbox", data_show=name, checked=True), f" {words}")


def space_data(results: Results) -> Html:
    """What `space.js` reads: rounded to centimetres and milliseconds."""
    limit = _limit(results)
    tracks = [participants.thin_trajectory(t, limit) for t in results.trajectories if len(t.time_s)]
    paths = participants.camera_paths(results, CAMERA_POINTS)
    start, end = participants.time_span(results)
    reach = _reach([t.position_enu_m[participants.well_known(results, t)] for t in tracks])
    return data_script(
        "flight",
        {
            "time": [start, end],
            "enlarge": enlargement([participants.known_part(results, t) for t in tracks], 700 / max(reach, 1.0), 9.0),
            "targets": [_target(results, t) for t in tracks],
            "cameras": [_camera(results, p) for p in paths],
        },
    )


def _limit(results: Results) -> int:
    """Samples of each trajectory that go into the page."""
    return max(200, POINTS // max(1, len(results.trajectories)))


def _reach(groups: list[Floats]) -> float:
    pool = np.concatenate([np.zeros((0, 3)), *groups])
    pool = pool[np.isfinite(pool).all(axis=1)]
    return float(np.ptp(pool, axis=0).max()) if len(pool) else 1.0


def _target(results: Results, track: Trajectory) -> Mapping[str, Any]:
    track = _finite(track)
    sure = participants.well_known(results, track)
    rings = np.flatnonzero(sure)[participants.thinned(int(sure.sum()), RINGS)]
    index = participants.targets(results).index(track.target)
    known = participants.true_trajectory(results, track.target)
    truth = [] if known is None else _cm(known.position_enu_m[participants.thinned(len(known.time_s), 600)])
    return {
        "name": track.target,
        "colour": index % participants.COLOURS,
        "t": np.round(track.time_s, 3).tolist(),
        "p": _cm(track.position_enu_m),
        "rings": rings.tolist(),
        "guess": np.flatnonzero(~sure).tolist(),
        "c": [_upper(c) for c in track.covariance[rings]],
        "truth": truth,
    }


def _finite(track: Trajectory) -> Trajectory:
    return participants.part_of(track, np.isfinite(track.position_enu_m).all(axis=1) & np.isfinite(track.time_s))


def _cm(position: Floats) -> list[list[float]]:
    return [[float(v) for v in row] for row in np.round(position, 2) if np.isfinite(row).all()]


def _upper(covariance: Floats) -> list[float] | None:
    """ee, en, eu, nn, nu, uu to four digits; None where unknown."""
    values = covariance[np.triu_indices(3)]
    return [float(f"{v:.4g}") for v in values] if np.isfinite(values).all() else None


def _camera(results: Results, path: CameraPath) -> Mapping[str, Any]:
    good = np.isfinite(path.position_enu_m).all(axis=1) & np.isfinite(path.time_s)
    width, height = results.image_size.get(path.camera, (4, 3))
    half = 0.5 * width / focal_px(results, path.camera)
    seen = {
        t: [[round(a, 3), round(b, 3)] for a, b in times_seen(results, path.camera, t)]
        for t in participants.targets(results)
    }
    return {
        "name": path.camera,
        "t": np.round(path.time_s[good], 3).tolist(),
        "p": _cm(path.position_enu_m[good]),
        "q": np.round(path.enu_from_cam[good], 5).tolist(),
        "half": [round(half, 4), round(half * height / width, 4)],
        "seen": seen,
    }


def focal_px(results: Results, camera: str) -> float:
    """Focal length that the sightings suggest, good enough to draw with; the image's width if none does."""
    sightings = results.solution.sightings
    width, height = results.image_size.get(camera, (4, 3))
    poses = next((p for p in results.solution.poses if p.camera == camera), None)
    rows = participants.rows_of(sightings, camera=camera)
    rows = rows[participants.thinned(len(rows), 400)]
    if poses is None or not len(poses.frame) or not len(rows):
        return float(width)
    at = np.searchsorted(poses.frame, sightings.frame[rows]).clip(0, len(poses.frame) - 1)
    ahead = rotation.rotate(
        rotation.conjugate(poses.enu_from_cam[at]), sightings.position_enu_m[rows] - poses.position_enu_m[at]
    )
    pixels = {
        (t.target, int(f)): xy
        for t in results.tracks
        if t.camera == camera
        for f, xy in zip(t.frame, t.xy_px, strict=True)
    }
    missing = np.full(2, np.nan)
    found = np.array([pixels.get((sightings.target[r], int(sightings.frame[r])), missing) for r in rows])
    off = np.linalg.norm(found - (np.array([width, height]) - 1) / 2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.linalg.norm(ahead[:, :2], axis=1) / ahead[:, 2]
    good = np.isfinite(off) & (slope > 0.02)
    return float(np.clip(np.median(off[good] / slope[good]), width / 6, width * 20)) if good.any() else float(width)


def space_section(results: Results) -> Html:
    """Figure and data together."""
    return joined(space_figure(results), films_figure(results), space_data(results))
