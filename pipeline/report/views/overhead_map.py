"""The map: everything from above, east to the right, north up, in metres.

Pixel = scale * (east - west edge, north edge - north). A second map looks at the targets closely where the cameras
are so far away that the first one must be small.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, geodetic_from_enu
from pipeline.records import Results, Trajectory
from pipeline.report.blocks import figure, key, note, target_legend
from pipeline.report.charts.axes import nice_step, round_ticks, span, tick_words
from pipeline.report.charts.ellipses import ellipse_path, enlargement
from pipeline.report.charts.placing import Box, place
from pipeline.report.data import participants
from pipeline.report.data.participants import CameraPath
from pipeline.report.text.markup import Html, joined, path, specks, tag
from pipeline.report.text.words import SIGMA, TIMES, degrees_of_place, rounded

WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 960, 420, 680
FIXES = 1500
ELLIPSES = 14


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A map sheet: its west and north edges in metres, pixels per metre, and its size in pixels."""

    west: float
    north: float
    scale: float
    width: float
    height: float

    def px(self, enu_m: Floats) -> Floats:
        """Pixels (n, 2) of ENU positions (n, 2 or 3)."""
        at = np.asarray(enu_m, float)
        return np.stack([(at[..., 0] - self.west) * self.scale, (self.north - at[..., 1]) * self.scale], axis=-1)


def map_figure(results: Results) -> Html:
    """One map of the whole scene and, where the targets fill little of it, a closer one of them."""
    paths, tracks = participants.camera_paths(results), _tracks(results)
    sheets = map_sheets(results)
    if not sheets:
        return note("There is nothing to draw: no position is known.")
    titles = ("All cameras and targets", "The targets, closer")
    maps = [_map(results, sheet, tracks, paths, title) for sheet, title in zip(sheets, titles, strict=False)]
    return joined(_ground_switch(results), *maps)


def map_sheets(results: Results) -> list[Sheet]:
    """What the maps show: everything, and the targets where they fill little of that; none where nothing is known."""
    on_ground = [t.position_enu_m[participants.well_known(results, t), :2] for t in _tracks(results)]
    paths = participants.camera_paths(results)
    everything = [*on_ground, *(p.position_enu_m[:, :2] for p in paths)]
    if not any(np.isfinite(a).any() for a in everything):
        return []
    whole, near = _sheet(everything), _sheet(on_ground)
    seen = any(np.isfinite(a).any() for a in on_ground)
    return [whole, near] if seen and paths and near.scale > 1.8 * whole.scale else [whole]


def _tracks(results: Results) -> list[Trajectory]:
    return [participants.thin_trajectory(t, FIXES) for t in results.trajectories if len(t.time_s)]


def _ground_switch(results: Results) -> Html:
    if not results.ground_pictures:
        return Html("")
    box = tag("input", type="checkbox", id="ground", checked=True)
    return tag("div", tag("label", box, " the ground, from the videos"), class_="controls")


def _ground(results: Results, sheet: Sheet) -> Html:
    """The ground from above, where it was made for this sheet."""
    own = [g for g in results.ground_pictures if abs(g.west_m - sheet.west) + abs(g.north_m - sheet.north) < 1e-6]
    if not own:
        return Html("")
    x, y = ((own[0].west_m - sheet.west) * sheet.scale, (sheet.north - own[0].north_m) * sheet.scale)
    wide, high = (own[0].east_m - own[0].west_m) * sheet.scale, (own[0].north_m - own[0].south_m) * sheet.scale
    encoded = base64.b64encode(own[0].webp).decode("ascii")
    return tag(
        "image", href=f"data:image/webp;base64,{encoded}", x=x, y=y, width=wide, height=high, class_="ground",
        preserveAspectRatio="none",
    )  # fmt: skip


def _sheet(groups: list[Floats]) -> Sheet:
    west, east = span(*(g[:, 0] for g in groups), pad=0.07, least=2.0)
    south, north = span(*(g[:, 1] for g in groups), pad=0.07, least=2.0)
    height = float(np.clip(WIDTH * (north - south) / (east - west), LEAST_HEIGHT, MOST_HEIGHT))
    scale = min(WIDTH / (east - west), height / (north - south))
    middle_e, middle_n = (east + west) / 2, (north + south) / 2
    return Sheet(
        west=middle_e - WIDTH / 2 / scale,
        north=middle_n + height / 2 / scale,
        scale=scale,
        width=WIDTH,
        height=float(round(height)),
    )


def _map(results: Results, sheet: Sheet, tracks: list[Trajectory], paths: tuple[CameraPath, ...], title: str) -> Html:
    factor = enlargement([participants.known_part(results, t) for t in tracks], sheet.scale, 12.0)
    every = _dot_interval(results)
    marks = [
        *_grid(sheet, _ground(results, sheet)),
        *(_corridor(results, sheet, t, factor) for t in tracks),
        *(_camera(sheet, p) for p in paths),
        *(_truth(results, sheet, t.target) for t in tracks),
        *(_target(results, sheet, t, every) for t in tracks),
        *_names(results, sheet, tracks, paths),
        _scale_bar(sheet, tracks),
        _north_arrow(sheet),
        *_moving_dots(results, paths),
    ]
    label = f"Map, {title.lower()}: {_spoken(sheet)}"
    numbers = {"data_west": f"{sheet.west:.3f}", "data_north": f"{sheet.north:.3f}", "data_scale": f"{sheet.scale:.6g}"}
    svg = tag(
        "svg",
        tag("title", label),
        *marks,
        class_="map",
        role="img",
        viewBox=f"0 0 {WIDTH} {sheet.height:.0f}",
        **numbers,
    )
    head = tag("h3", title)
    return tag(
        "div", head, figure(svg, caption=_caption(results, sheet, factor, every), legend=_legend(results), wide=True)
    )


def _has_sigmas(results: Results) -> bool:
    return any(np.isfinite(t.covariance).any() for t in results.trajectories)


def _spoken(sheet: Sheet) -> str:
    across, up = (rounded(side / sheet.scale, 3) for side in (sheet.width, sheet.height))
    return f"{across} m from west to east, {up} m from south to north."


def _legend(results: Results) -> Html:
    keys = [key("camera line", "camera path, lines of sight along it")]
    if _has_sigmas(results):
        keys.append(key("ell1", f"1{SIGMA}, 2{SIGMA}", "M4 6a8 5 0 1 0 16 0a8 5 0 1 0 -16 0Z"))
    if results.truth is not None:
        keys.append(key("truth", "truth"))
    if not all(participants.well_known(results, t).all() for t in results.trajectories):
        keys.append(key("unsure c-ink", "not seen, a guess"))
    return target_legend(results, *keys, only=[t.target for t in results.trajectories])


def _caption(results: Results, sheet: Sheet, factor: int, every: float) -> str:
    size = "drawn at true size" if factor == 1 else f"drawn {factor} {TIMES} larger than they are"
    ellipses = f"Ellipses of one and two sigma are {size}. " if _has_sigmas(results) else ""
    ground = "".join(f" {g.words}" for g in results.ground_pictures[:1])
    dots = f"Rings mark where a target starts, discs where it ends, small dots every {rounded(every, 1)} s."
    words = f"{ellipses}{dots}{participants.thinning_words(results, FIXES)}{ground}"
    if results.origin is None:
        return f"{words} East and north in metres from the local origin."
    corners = np.array([[0.0, sheet.height], [sheet.width, 0.0]]) / sheet.scale
    low, high = (_place(sheet.west + c[0], sheet.north - c[1], results.origin) for c in corners)
    return (
        f"{words} East and north in metres from the origin; south-west corner {low}, north-east corner {high} (WGS84)."
    )


def _place(east: float, north: float, origin: Geodetic) -> str:
    lat, lon, _ = geodetic_from_enu(np.array([east, north, 0.0]), origin)
    return degrees_of_place(float(np.degrees(lat)), float(np.degrees(lon)))


def _dot_interval(results: Results) -> float:
    start, end = participants.time_span(results)
    return nice_step(end - start, 10)


def _grid(sheet: Sheet, under: Html) -> list[Html]:
    east, south = sheet.west + sheet.width / sheet.scale, sheet.north - sheet.height / sheet.scale
    step = nice_step(sheet.width / sheet.scale, 9)
    out = [tag("rect", width=sheet.width, height=sheet.height, class_="frame"), under]
    for value, words in round_ticks(sheet.west, east, step=step):
        at = (value - sheet.west) * sheet.scale
        out.append(tag("line", x1=at, x2=at, y1=0, y2=sheet.height, class_="grid"))
        if 40 < at < sheet.width - 90:
            out.append(tag("text", words, x=at + 4, y=sheet.height - 6, class_="tick"))
    for value, words in round_ticks(south, sheet.north, step=step):
        at = (sheet.north - value) * sheet.scale
        out.append(tag("line", x1=0, x2=sheet.width, y1=at, y2=at, class_="grid"))
        if 38 < at < sheet.height - 75:
            out.append(tag("text", words, x=5, y=at - 4, class_="tick"))
    return [
        *out,
        tag("text", "east, m", x=sheet.width - 6, y=sheet.height - 6, text_anchor="end", class_="name"),
        tag("text", "north, m", x=5, y=6, class_="name", dominant_baseline="hanging"),
    ]


def _corridor(results: Results, sheet: Sheet, trajectory: Trajectory, factor: int) -> Html:
    known = np.flatnonzero(participants.well_known(results, trajectory))
    at = known[_evenly_along(trajectory.position_enu_m[known, :2], ELLIPSES)]
    centres = sheet.px(trajectory.position_enu_m[at])
    flip = np.diag([1.0, -1.0]) * sheet.scale * factor
    covariances = flip @ trajectory.covariance[at][:, :2, :2] @ flip.T
    rings = [
        tag(
            "path",
            class_=f"ell{k}",
            d="".join(ellipse_path(p, c, k) for p, c in zip(centres, covariances, strict=True)),
        )
        for k in (2, 1)
    ]
    return tag("g", *rings, class_=participants.tone(results, trajectory.target))


def _evenly_along(position: Floats, count: int) -> Ints:
    """Indices of points evenly spaced along the path, the first and the last among them."""
    steps = np.nan_to_num(np.linalg.norm(np.diff(position, axis=0), axis=1))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    if way[-1] <= 0:
        return np.array([0])
    return np.unique(np.searchsorted(way, np.linspace(0, way[-1], count)).clip(0, len(position) - 1))


def _target(results: Results, sheet: Sheet, trajectory: Trajectory, every: float) -> Html:
    px = sheet.px(trajectory.position_enu_m)
    beats = np.arange(np.ceil(trajectory.time_s[0] / every), np.floor(trajectory.time_s[-1] / every) + 1) * every
    at_beats = np.stack([np.interp(beats, trajectory.time_s, px[:, i]) for i in (0, 1)], axis=1)
    known = participants.well_known(results, trajectory)
    sure = np.where(known[:, None], px, np.nan)
    marks = [] if known.all() else [tag("path", d=path(px), class_="unsure")]
    marks += [tag("path", d=path(sure), class_="line"), tag("path", d=specks(at_beats), class_="beats")]
    ends = (("start", px[0], 5.5), ("end", px[-1], 5.5))
    marks += [tag("circle", cx=float(p[0]), cy=float(p[1]), r=r, class_=c) for c, p, r in ends if np.isfinite(p).all()]
    return tag("g", *marks, class_=participants.tone(results, trajectory.target))


def _truth(results: Results, sheet: Sheet, target: str) -> Html:
    known = participants.true_trajectory(results, target)
    if known is None:
        return Html("")
    thin = known.position_enu_m[participants.thinned(len(known.time_s), FIXES)]
    return tag("path", d=path(sheet.px(thin)), class_="truth")


def _camera(sheet: Sheet, camera: CameraPath) -> Html:
    px = sheet.px(camera.position_enu_m)
    at = np.array([0]) if camera.still else participants.thinned(len(px), 7)
    forward = rotation.rotate(camera.enu_from_cam[at], np.array([0.0, 0.0, 1.0]))[:, :2] * np.array([1.0, -1.0])
    long = np.linalg.norm(forward, axis=1, keepdims=True)
    tips = px[at] + 34 * forward / np.where(long > 0, long, 1)
    looks = "".join(path(np.stack([a, b])) for a, b in zip(px[at], tips, strict=True))
    first = px[0]
    box = tag("rect", x=float(first[0]) - 5, y=float(first[1]) - 5, width=10, height=10, class_="camera box")
    return tag("g", tag("path", d=path(px), class_="camera line"), tag("path", d=looks, class_="camera look"), box)


def _names(results: Results, sheet: Sheet, tracks: list[Trajectory], paths: tuple[CameraPath, ...]) -> list[Html]:
    ends = [(sheet.px(t.position_enu_m[-1]), t.target, participants.tone(results, t.target)) for t in tracks]
    ends += [(sheet.px(p.position_enu_m[0]), p.camera, "camera") for p in paths]
    inside = [
        (p, w, c) for p, w, c in ends if np.isfinite(p).all() and 0 <= p[0] <= sheet.width and 0 <= p[1] <= sheet.height
    ]
    taken = [*_furniture(sheet), *_lines_as_boxes(sheet, [*tracks, *paths])]
    spots = place([(float(p[0]), float(p[1]), w) for p, w, _ in inside], sheet.width, sheet.height, taken)
    return [
        tag("text", words, x=x, y=y, text_anchor=anchor, class_=f"label {c}")
        for (x, y, anchor), (_, words, c) in zip(spots, inside, strict=True)
    ]


def _furniture(sheet: Sheet) -> list[Box]:
    return [(sheet.width - 50, 0, sheet.width, 64), (0, sheet.height - 64, 240, sheet.height), (0, 0, 80, 24)]


def _lines_as_boxes(sheet: Sheet, tracks: Sequence[Trajectory | CameraPath]) -> list[Box]:
    """Small boxes along the paths, for names to keep clear of."""
    along = [sheet.px(t.position_enu_m[_evenly_along(t.position_enu_m[:, :2], 60)]) for t in tracks]
    return [(x - 4, y - 4, x + 4, y + 4) for px in along for x, y in px.tolist() if x == x and y == y]


def _scale_bar(sheet: Sheet, tracks: list[Trajectory]) -> Html:
    """Bottom left, or bottom right where that hides less of the trajectories."""
    step = nice_step(sheet.width / sheet.scale, 7)
    long = step * sheet.scale
    y = sheet.height - 34
    bar = tag("path", d=f"M0 -5V0H{long:.1f}V-5", class_="bar")
    words = tag(
        "text", f"{tick_words(step, 0 if step >= 1 else 2)} m", x=long / 2, y=-8, text_anchor="middle", class_="name"
    )
    back = tag("rect", x=-8, y=-24, width=long + 16, height=30, class_="frame clear")
    boxes = _lines_as_boxes(sheet, tracks)
    under = {x: sum(x - 20 < b[0] < x + long + 20 and b[3] > y - 30 for b in boxes) for x in (44, WIDTH - 44 - long)}
    return tag("g", back, bar, words, transform=f"translate({min(under, key=under.__getitem__):.0f} {y:.0f})")


def _north_arrow(sheet: Sheet) -> Html:
    arrow = tag("path", d="M0 -22L7 4L0 -1L-7 4Z", class_="arrow")
    words = tag("text", "N", y=20, text_anchor="middle", class_="name")
    return tag("g", arrow, words, transform=f"translate({sheet.width - 26:.0f} 34)")


def _moving_dots(results: Results, paths: tuple[CameraPath, ...]) -> list[Html]:
    """Marks that the page moves to the chosen time; out of sight until then."""
    dots = [(f"target {participants.tone(results, t.target)}", t.target) for t in results.trajectories]
    dots += [("camera", p.camera) for p in paths]
    return [tag("circle", cx=-99, cy=-99, r=6, class_=f"now {c}", data_name=name) for c, name in dots]
