"""Small charts: a framed panel with grid, ticks and axis names, and the marks that go into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats
from pipeline.report.charts.axes import Scale
from pipeline.report.text.markup import Html, joined, path, specks, tag

EDGE = 12


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A chart of `width` x `height`; margins hold ticks and names. Scales map into the plot area, y upwards."""

    x: Scale
    y: Scale
    width: int
    height: int
    left: int
    top: int

    @property
    def inner(self) -> tuple[float, float]:
        """Width and height of the plot area."""
        return abs(self.x.end - self.x.start), abs(self.y.end - self.y.start)


def panel(
    x: tuple[float, float],
    y: tuple[float, float],
    *,
    width: int = 440,
    height: int = 230,
    left: int = 58,
    log_y: bool = False,
    log_x: bool = False,
    equal: bool = False,
    top: int = 12,
) -> Panel:
    """A panel over the ranges `x` and `y`; `equal` widens one of them until a unit is as long on both axes."""
    inner_w, inner_h = width - left - EDGE, height - top - 40
    if equal:
        unit = max((x[1] - x[0]) / inner_w, (y[1] - y[0]) / inner_h)
        x, y = _widened(x, unit * inner_w), _widened(y, unit * inner_h)
    return Panel(
        x=Scale(low=x[0], high=x[1], start=0, end=inner_w, log=log_x),
        y=Scale(low=y[0], high=y[1], start=inner_h, end=0, log=log_y),
        width=width,
        height=height,
        left=left,
        top=top,
    )


def _widened(span: tuple[float, float], length: float) -> tuple[float, float]:
    middle = (span[0] + span[1]) / 2
    return middle - length / 2, middle + length / 2


def points(p: Panel, x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
    """Pixels (n, 2) inside the plot area."""
    return np.stack([p.x(x), p.y(y)], axis=-1)


def line(p: Panel, x: npt.ArrayLike, y: npt.ArrayLike, class_: str = "line", **more: Any) -> Html:
    """A curve; NaN breaks it."""
    return tag("path", d=path(points(p, x, y)), class_=class_, **more)


def known_line(p: Panel, x: npt.ArrayLike, y: npt.ArrayLike, known: Bools, class_: str = "line") -> Html:
    """A curve that is dotted where it is not `known` (n,)."""
    whole = Html("") if known.all() else line(p, x, y, "unsure")
    return joined(whole, line(p, x, np.where(known, np.asarray(y, float), np.nan), class_))


def band(p: Panel, x: npt.ArrayLike, low: npt.ArrayLike, high: npt.ArrayLike, class_: str = "band") -> Html:
    """The area between two curves."""
    up, down = points(p, x, high), points(p, x, low)[::-1]
    both = np.concatenate([up, down])
    return tag("path", d=path(both[np.isfinite(both).all(axis=1)], closed=True), class_=class_)


def dots(p: Panel, x: npt.ArrayLike, y: npt.ArrayLike, class_: str = "dots") -> Html:
    """Round marks."""
    return tag("path", d=specks(points(p, x, y)), class_=class_)


def level(p: Panel, y: float, class_: str = "level") -> Html:
    """A horizontal line over the whole width."""
    at = p.y.at(y)
    return tag("line", x1=0, x2=p.inner[0], y1=at, y2=at, class_=class_)


def chart(
    p: Panel,
    marks: Sequence[Html],
    *,
    label: str,
    x_label: str = "",
    y_label: str = "",
    title: str = "",
    **more: Any,
) -> Html:
    """The panel with its heading, as the page shows it; `more` is that of `drawing`."""
    head = tag("h4", title) if title else Html("")
    return tag("div", head, drawing(p, marks, label=label, x_label=x_label, y_label=y_label, **more), class_="panel")


def drawing(
    p: Panel,
    marks: Sequence[Html],
    *,
    label: str,
    x_label: str = "",
    y_label: str = "",
    time: bool = False,
    over: Sequence[Html] = (),
    y_ticks: Sequence[tuple[float, str]] | None = None,
    x_count: int = 5,
    y_count: int = 5,
    **place: Any,
) -> Html:
    """The panel as one SVG; `label` says in words what it shows, `place` are further attributes of it.

    `time` marks the x axis as common time for the page. `marks` are cut off at the plot area, `over` is not.
    """
    w, h = p.inner
    y_axis = _y_axis(p, p.y.ticks(y_count), True) if y_ticks is None else _y_axis(p, y_ticks, False)
    grid = [*_x_axis(p, x_count), *y_axis]
    clipped = tag("svg", *marks, width=w, height=h, overflow="hidden")
    names = [
        tag("text", x_label, x=w / 2, y=h + 34, class_="name", text_anchor="middle"),
        tag("text", y_label, transform=f"translate({-p.left + 9} {h / 2:.0f}) rotate(-90)", class_="name middle"),
    ]
    body = tag("g", *grid, clipped, *names, *over, transform=f"translate({p.left} {p.top})")
    moment: dict[str, Any] = {}
    if time:
        moment = {"data_t0": f"{p.x.low:.6g}", "data_t1": f"{p.x.high:.6g}", "data_x0": p.left, "data_x1": p.left + w}
        body = joined(body, tag("line", class_="moment", y1=p.top, y2=p.top + h, x1=-9, x2=-9))
    return tag(
        "svg", tag("title", label), body, viewBox=f"0 0 {p.width} {p.height}", role="img", class_="chart",
        **moment, **place,
    )  # fmt: skip


def _x_axis(p: Panel, count: int) -> list[Html]:
    w, h = p.inner
    out = [tag("rect", width=w, height=h, class_="frame")]
    for value, words in p.x.ticks(count):
        at = p.x.at(value)
        out.append(tag("line", x1=at, x2=at, y1=0, y2=h, class_="grid"))
        held = min(at, w + EDGE - 3.2 * len(words))
        out.append(tag("text", words, x=held, y=h + 16, text_anchor="middle"))
    return out


def _y_axis(p: Panel, ticks: Sequence[tuple[float, str]], zero: bool) -> list[Html]:
    w, _ = p.inner
    out = []
    for value, words in ticks:
        at = p.y.at(value)
        out.append(tag("line", x1=0, x2=w, y1=at, y2=at, class_="grid zero" if zero and value == 0 else "grid"))
        out.append(tag("text", words, x=-6, y=at, text_anchor="end", class_="ytick"))
    return out
