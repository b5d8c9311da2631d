"""Curves over a factor, one panel for each value of another: the paper's Figures 7, 8 and 10."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Curve, Value
from pipeline.experiments.statistics.figures import figure_of
from pipeline.experiments.statistics.summary import Outcome
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import Panel, chart, dots, line, panel, points
from pipeline.report.text.markup import Html, joined, tag

BOUND = "bound"


def tone(number: int, ours: bool) -> str:
    """The class that colours an approach's lines; ours are drawn thick."""
    return f"c{number % 8}" + (" ours" if ours else "")


def curve_figure(outcome: Outcome, curve: Curve) -> Html:
    """The figure with its legend."""
    panels = list(dict.fromkeys(c.values.get(curve.panel, "") for c in outcome.experiment.cells))
    data = {p: panel_data(outcome, curve, p) for p in panels}
    everything = np.concatenate([np.concatenate([y - s, y + s]) for d in data.values() for _, y, s in d.values()])
    if curve.log_y:
        everything = everything[everything > 0]
        low, high = float(np.nanmin(everything)) / 1.2, float(np.nanmax(everything)) * 1.2
    else:
        low, high = span(everything, np.zeros(1) if curve.spread == "error" else np.zeros(0))
        low = max(low, 0.0) if curve.spread == "error" else low
    drawn = [_panel(outcome, curve, p, data[p], (low, high)) for p in panels]
    return tag("figure", _legend(outcome), tag("div", *drawn, class_="panels"), tag("figcaption", curve.caption))


Series = dict[str, tuple[Floats, Floats, Floats]]


def panel_data(outcome: Outcome, curve: Curve, which: Value) -> Series:
    """x, y and half the bar of every approach, and of the bound, in one panel."""
    e = outcome.experiment
    cells = [i for i, c in enumerate(e.cells) if c.values.get(curve.panel, "") == which]
    out: Series = {}
    limit: dict[float, float] = {}
    for a, approach in enumerate(e.approaches):
        found = [(float(e.cells[c].values[curve.x]), outcome.entry(c, a)) for c in cells]
        rows = [(x, figure_of(outcome, entry, curve.measure)) for x, entry in found if entry is not None]
        if not rows:
            continue
        bar = [f.deviation if curve.spread == "deviation" else f.error for _, f in rows]
        out[approach.name] = (
            np.array([x for x, _ in rows]), np.array([f.value for _, f in rows]), np.nan_to_num(np.array(bar)),
        )  # fmt: skip
        limit |= {x: f.bound for x, f in rows if np.isfinite(f.bound)}
    if limit:
        x = np.array(sorted(limit))
        out[BOUND] = (x, np.array([limit[v] for v in x]), np.zeros(len(x)))
    return out


def _panel(outcome: Outcome, curve: Curve, which: Value, data: Series, y: tuple[float, float]) -> Html:
    all_x = np.concatenate([s[0] for s in data.values()])
    p = panel(span(all_x), y, log_y=curve.log_y)
    marks: list[Html] = []
    count = max(len(data), 1)
    for i, (name, (x, value, bar)) in enumerate(data.items()):
        tone = _tone(outcome, name)
        shift = (i - (count - 1) / 2) * 0.012 * float(np.ptp(all_x)) if curve.spread == "deviation" else 0.0
        marks.append(line(p, x + shift, value, class_=f"line {tone}"))
        if name != BOUND:
            marks += [dots(p, x + shift, value, class_=f"dots {tone}"), _bars(p, x + shift, value, bar, tone)]
    label = f"{curve.caption}, {curve.panel} {which}" if curve.panel else curve.caption
    title = f"{curve.panel} {which}" if curve.panel else ""
    return chart(p, marks, label=label, x_label=curve.x.replace("_", " "), title=title)


def _bars(p: Panel, x: Floats, value: Floats, bar: Floats, tone: str) -> Html:
    low, high = points(p, x, value - bar), points(p, x, value + bar)
    strokes = "".join(
        f"M{a[0]:.1f} {a[1]:.1f}V{b[1]:.1f}" for a, b in zip(low, high, strict=True) if np.isfinite([*a, *b]).all()
    )
    return tag("path", d=strokes, class_=f"bar {tone}")


def _tone(outcome: Outcome, name: str) -> str:
    if name == BOUND:
        return "bound"
    return tone(
        outcome.experiment.approach(name), outcome.experiment.approaches[outcome.experiment.approach(name)].ours
    )


def _legend(outcome: Outcome) -> Html:
    keys = []
    for i, a in enumerate(outcome.experiment.approaches):
        sample = tag(
            "svg", tag("path", d="M1 6H23", class_=f"line {tone(i, a.ours)}"), width=24, height=12, aria_hidden="true"
        )
        keys.append(tag("li", sample, joined(a.name, " (ours)" if a.ours else "")))
    sample = tag("svg", tag("path", d="M1 6H23", class_="line bound"), width=24, height=12, aria_hidden="true")
    keys.append(tag("li", sample, BOUND))
    return tag("ul", *keys, class_="legend")
