"""What is left over in the images: observed minus predicted pixel of every sighting.

Where the model is right, the length of a residual in sigmas follows a Rayleigh distribution, r exp(-r^2 / 2).
"""

from __future__ import annotations

import math

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.records import Results, Sightings
from pipeline.report.blocks import figure, key, note, table, target_legend
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import Panel, chart, dots, level, line, panel, points
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, path, tag
from pipeline.report.text.words import fixed, rounded, whole

DRAWN, ARROWS = 2000, 350
SIDE, HIGH = 262, 236
FAR_SIGMAS = 8.0
TIME = "common time, s"


def residual_figures(results: Results) -> Html:
    """A table of all cameras, then four drawings for each: over the image, as a cloud, over time, as a histogram."""
    sightings = results.solution.sightings
    if not len(sightings.frame):
        return note("No residuals are recorded.")
    whole_table = _camera_table(results)
    legend = target_legend(results, key("expected", "expected of a right model"))
    absorbed = note(
        "Poses that are corrected frame by frame take up a part of every residual: the histogram then rightly lies to "
        "the left of the curve. Chi-square per degree of freedom allows for that."
    )
    return joined(
        whole_table,
        absorbed,
        _redundancies(results),
        legend,
        *(_camera(results, c) for c in participants.cameras(results)),
    )


def _redundancies(results: Results) -> Html:
    """What is left over to check each camera and target with, and what it says."""
    rows = [
        (r.subject, r.kind, whole(r.equations), rounded(r.redundancy, 4), fixed(r.chi_square / r.redundancy, 2))
        for r in results.solution.redundancies
        if r.redundancy > 0
    ]
    if not rows:
        return Html("")
    head = ("of", "", "equations", "redundancy", "chi-square over redundancy")
    return table(
        head, rows, caption="Redundancy of each camera and target (the last column is one on average)", words=2
    )


def _camera_table(results: Results) -> Html:
    head = (
        "camera",
        "image, px",
        "sightings",
        "rms across, px",
        "rms down, px",
        "rms, sigmas per axis",
        "under half weight",
    )
    rows = [_camera_row(results, c) for c in participants.cameras(results)]
    return table(head, rows, caption="Residuals of each camera")


def _camera_row(results: Results, camera: str) -> list[str]:
    sightings = results.solution.sightings
    at = participants.rows_of(sightings, camera=camera)
    size = results.image_size.get(camera)
    image = f"{size[0]} \u00d7 {size[1]}" if size else "unknown"
    if not len(at):
        return [camera, image, "0", "", "", "", ""]
    across, down = (_rms(sightings.residual_px[at, i]) for i in (0, 1))
    sigmas = _rms(sightings.residual_sigma[at]) / math.sqrt(2)
    low = float(np.mean(sightings.weight[at] < 0.5))
    return [
        camera,
        image,
        whole(len(at)),
        rounded(across, 3),
        rounded(down, 3),
        fixed(sigmas, 2),
        f"{fixed(100 * low, 1)} %",
    ]


def _rms(values: Floats) -> float:
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else math.nan


def _camera(results: Results, camera: str) -> Html:
    sightings = results.solution.sightings
    rows = participants.rows_of(sightings, camera=camera)
    if not len(rows):
        return Html("")
    shown, odd = _chosen(sightings, rows)
    reach = _reach(sightings, rows)
    panels = (
        _over_image(results, camera, shown),
        _cloud(results, shown, reach, _sigma_px(sightings, rows)),
        _over_time(results, shown, reach),
        _histogram(sightings, rows),
    )
    return tag(
        "div", tag("h3", camera), figure(*panels, caption=_caption(len(rows), len(shown), odd, reach)), class_="four"
    )


def _caption(total: int, shown: int, odd: int, reach: float) -> str:
    far = f"Strokes in the image are residuals, enlarged. A residual beyond {rounded(reach)} px lies on the edge."
    if shown == total:
        return far
    drawn = f"{whole(shown)} of {whole(total)} sightings are drawn, the {whole(odd)} largest among them"
    return f"{drawn}; histogram and table count all. {far}"


def _chosen(sightings: Sightings, rows: Ints) -> tuple[Ints, int]:
    """Rows to draw, at most DRAWN: the largest tenth of them first, the rest evenly thinned."""
    if len(rows) <= DRAWN:
        return rows, 0
    size = np.nan_to_num(sightings.residual_sigma[rows])
    far = rows[np.argsort(-size, kind="stable")[: DRAWN // 10]]
    rest = np.setdiff1d(rows, far)
    return np.sort(np.concatenate([far, rest[participants.thinned(len(rest), DRAWN - len(far))]])), len(far)


def _reach(sightings: Sightings, rows: Ints) -> float:
    """Half the side of the drawings in px: nearly all residuals fit, a few outliers do not squash them."""
    size = np.abs(sightings.residual_px[rows])
    size = size[np.isfinite(size)]
    return max(float(np.quantile(size, 0.99)) * 1.5, 1e-3) if len(size) else 1.0


def _sigma_px(sightings: Sightings, rows: Ints) -> float:
    length, sigmas = np.linalg.norm(sightings.residual_px[rows], axis=1), sightings.residual_sigma[rows]
    good = np.isfinite(length) & (sigmas > 0.05)
    return float(np.median(length[good] / sigmas[good])) if good.any() else 0.0


def _by_target(results: Results, rows: Ints) -> list[tuple[str, Ints]]:
    names = np.array(results.solution.sightings.target, object)[rows]
    return [(t, rows[names == t]) for t in participants.targets(results) if (names == t).any()]


def _over_image(results: Results, camera: str, rows: Ints) -> Html:
    width, height = results.image_size.get(camera, (1, 1))
    p = panel((0.0, float(width)), (-float(height), 0.0), width=SIDE, height=HIGH, left=50, equal=True)
    sightings = results.solution.sightings
    rows = rows[participants.thinned(len(rows), ARROWS)]
    lengths = np.linalg.norm(sightings.residual_px[rows], axis=1)
    lengths = lengths[lengths > 0]
    typical = float(np.median(lengths)) if len(lengths) else 1.0
    longer = width * 0.022 / typical
    marks = [
        tag("path", d=path(points(p, [0, width, width, 0], [0, 0, -height, -height]), closed=True), class_="image")
    ]
    for target, at in _by_target(results, rows):
        px = _observed(results, camera, target, at)
        arrow = np.clip(sightings.residual_px[at] * longer, -0.2 * width, 0.2 * width)
        ends = np.stack([px, px + arrow, np.full_like(px, np.nan)], axis=1).reshape(-1, 2)
        drawn = [line(p, ends[:, 0], -ends[:, 1], "arrow"), dots(p, px[:, 0], -px[:, 1], "dots")]
        marks.append(tag("g", *drawn, class_=participants.tone(results, target)))
    y_ticks = [(-v, w) for v, w in panel((0, 1), (0, float(height))).y.ticks(3)]
    label = f"Where in the image of {camera} the residuals point; strokes {rounded(longer)} times longer"
    return chart(
        p, marks, label=label, title=f"In the image (\u00d7 {rounded(longer)})", x_label="x, px",
        y_label="y, px", y_ticks=y_ticks, x_count=4,
    )  # fmt: skip


def _observed(results: Results, camera: str, target: str, rows: Ints) -> Floats:
    """Pixels (n, 2) of the sightings `rows`, looked up in the image tracks; NaN where there is none."""
    frames = results.solution.sightings.frame[rows]
    track = next((t for t in results.tracks if t.camera == camera and t.target == target), None)
    if track is None or not len(track.frame):
        return np.full((len(rows), 2), np.nan)
    at = np.searchsorted(track.frame, frames).clip(0, len(track.frame) - 1)
    hit: Bools = track.frame[at] == frames
    return np.where(hit[:, None], track.xy_px[at], np.nan)


def _cloud(results: Results, rows: Ints, reach: float, sigma_px: float) -> Html:
    p = panel((-reach, reach), (-reach, reach), width=SIDE, height=HIGH, left=50, equal=True)
    marks = []
    held = np.clip(results.solution.sightings.residual_px, -reach, reach)
    for target, at in _by_target(results, rows):
        marks.append(
            tag("g", dots(p, held[at, 0], -held[at, 1], "dots thin"), class_=participants.tone(results, target))
        )
    marks += [_ring(p, k * sigma_px) for k in (1, 2, 3) if sigma_px > 0]
    return chart(
        p, marks, label="Residuals as a cloud, rings at 1, 2 and 3 sigma", title="Cloud, 1 2 3\u03c3",
        x_label="right, px", y_label="up, px", x_count=3,
    )  # fmt: skip


def _ring(p: Panel, radius: float) -> Html:
    turn = np.linspace(0, 2 * np.pi, 49)
    return line(p, radius * np.cos(turn), radius * np.sin(turn), "ring")


def _over_time(results: Results, rows: Ints, reach: float) -> Html:
    sightings = results.solution.sightings
    p = panel(participants.time_span(results), (-reach, reach), width=SIDE, height=HIGH, left=50)
    marks = [level(p, 0.0)]
    for target, at in _by_target(results, rows):
        held = np.clip(sightings.residual_px[at], -reach, reach)
        drawn = [dots(p, sightings.time_s[at], held[:, i], "dots thin") for i in (0, 1)]
        marks.append(tag("g", *drawn, class_=participants.tone(results, target)))
    return chart(
        p, marks, label="Residuals over time, both axes", title="Over time", x_label=TIME,
        y_label="residual, px", time=True, x_count=4,
    )  # fmt: skip


def _histogram(sightings: Sightings, rows: Ints) -> Html:
    size = sightings.residual_sigma[rows]
    size = size[np.isfinite(size)]
    far = int(np.count_nonzero(size > FAR_SIGMAS))
    reach = float(np.clip(np.quantile(size, 0.995) * 1.1, 4.0, FAR_SIGMAS)) if len(size) else 4.0
    edges = np.linspace(0, reach, 29)
    share = np.histogram(np.minimum(size, reach * 0.999), edges)[0] / max(len(size), 1) / (edges[1] - edges[0])
    at = np.linspace(0, reach, 80)
    expected = at * np.exp(-(at**2) / 2)
    p = panel((0.0, reach), span(np.zeros(1), share, expected), width=SIDE, height=HIGH, left=50)
    p = panel((0.0, reach), (0.0, p.y.high), width=SIDE, height=HIGH, left=50)
    steps = np.stack([np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(share, 2), [0.0]])], axis=1)
    marks = [
        tag("path", d=path(points(p, steps[:, 0], steps[:, 1]), closed=True), class_="bars"),
        line(p, at, expected, "expected"),
    ]
    title = "In sigmas" + (f" ({whole(far)} beyond {FAR_SIGMAS:.0f})" if far else "")
    return chart(
        p, marks, label="Histogram of the residuals' length in sigmas with the Rayleigh curve expected of it",
        title=title, x_label="length, sigmas", y_label="share per sigma",
    )  # fmt: skip
