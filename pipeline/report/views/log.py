"""A picture of a flight log, as one SVG: the way flown, height, attitude, gimbal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import LogPaths
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import Panel, dots, drawing, line, panel
from pipeline.report.text.markup import Html, tag

WIDTH, HEIGHT, EDGE, HEAD = 520, 300, 20, 56
COLOURS = ("#1b6ca8", "#c2571a", "#3f7d3a")
ANGLES = ("yaw", "pitch", "roll")
STYLE = """
svg { font-family: system-ui, sans-serif; }
text { font-size: 11.5px; fill: #555; } .title { font-size: 20px; fill: #111; }
.head { font-size: 13px; font-weight: 600; fill: #111; } .middle { text-anchor: middle; }
.ytick { dominant-baseline: central; } .frame { fill: #fff; stroke: #bbb; } .grid { stroke: #e4e4e4; }
.line { fill: none; stroke: #1b6ca8; stroke-width: 1.6; stroke-linejoin: round; }
.dots { fill: none; stroke: #c2571a; stroke-width: 6; stroke-linecap: round; }
"""


def log_picture(name: str, paths: LogPaths) -> str:
    """The picture of a log called `name`: a panel each for what it holds."""
    panels = [p for p in (_map(paths), _height(paths), *_attitudes(paths)) if p is not None]
    rows = max(1, -(-len(panels) // 2))
    width, height = 2 * WIDTH + 3 * EDGE, HEAD + rows * (HEIGHT + 2 * EDGE)
    placed = [
        tag("g", drawn, transform=f"translate({EDGE + (WIDTH + EDGE) * column} {HEAD + (HEIGHT + 2 * EDGE) * row})")
        for (row, column), drawn in zip((divmod(i, 2) for i in range(len(panels))), panels, strict=True)
    ]
    words = "" if panels else "no position and no attitude in this log"
    return (
        str(
            tag(
                "svg",
                tag("title", f"Flight log {name}"),
                tag("style", Html(STYLE)),
                tag("rect", width=width, height=height, fill="#f7f7f5"),
                tag("text", name, x=EDGE, y=34, class_="title"),
                tag("text", words, x=EDGE, y=HEAD + 20),
                *placed,
                xmlns="http://www.w3.org/2000/svg",
                viewBox=f"0 0 {width} {height}",
                width=width,
                height=height,
            )
        )
        + "\n"
    )


def _map(paths: LogPaths) -> Html | None:
    east, north = paths.east_north_height_m[:, 0], paths.east_north_height_m[:, 1]
    if not np.isfinite(east).any():
        return None
    p = _panel(span(east, least=2.0), span(north, least=2.0), equal=True)
    marks = [line(p, east, north), dots(p, east[:1], north[:1])]
    return _titled("Way flown; the dot is its begin", p, marks, "east, m", "north, m")


def _height(paths: LogPaths) -> Html | None:
    height = paths.east_north_height_m[:, 2]
    if not np.isfinite(height).any():
        return None
    p = _panel(span(paths.place_s, pad=0.0, least=1.0), span(height, least=2.0))
    marks = [line(p, paths.place_s, height)]
    if len(paths.event_s):
        marks.append(dots(p, paths.event_s, np.full(len(paths.event_s), p.y.low)))
    title = "Height" + ("; dots: camera events" if len(paths.event_s) else "")
    return _titled(title, p, marks, "log time, s", "height, m")


def _attitudes(paths: LogPaths) -> list[Html | None]:
    return [
        _angles("Attitude of the vehicle", paths.body_s, paths.body_ypr_rad),
        _angles("Attitude of the gimbal", paths.gimbal_s, paths.gimbal_ypr_rad),
    ]


def _angles(title: str, time_s: Floats, ypr_rad: Floats) -> Html | None:
    degrees = np.degrees(ypr_rad)
    if not np.isfinite(degrees).any():
        return None
    p = _panel(span(time_s, pad=0.0, least=1.0), span(degrees, least=2.0))
    marks = [line(p, time_s, degrees[:, i], style=f"stroke:{COLOURS[i]}") for i in range(3)]
    legend = [
        tag("text", word, x=p.inner[0] - 44 * (3 - i) + 40, y=-8, text_anchor="end", style=f"fill:{COLOURS[i]}")
        for i, word in enumerate(ANGLES)
    ]
    return _titled(title, p, marks, "log time, s", "degrees", legend)


def _panel(x: tuple[float, float], y: tuple[float, float], *, equal: bool = False) -> Panel:
    return panel(x, y, width=WIDTH, height=HEIGHT, top=24, equal=equal)


def _titled(title: str, p: Panel, marks: Sequence[Html], x: str, y: str, over: Sequence[Html] = ()) -> Html:
    head = tag("text", title, x=0, y=-8, class_="head")
    return drawing(p, marks, label=title, x_label=x, y_label=y, over=[head, *over], width=p.width, height=p.height)
