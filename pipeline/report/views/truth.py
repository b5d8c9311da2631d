"""Against the truth, where it is known: each figure before and after, beside the sigma that was claimed."""

from __future__ import annotations

import math

import numpy as np

from pipeline.records import Comparison, Results, Trajectory
from pipeline.report.blocks import figure, key, note, table
from pipeline.report.charts.axes import Scale
from pipeline.report.charts.plot import band, chart, known_line, panel
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.text.words import SIGMA, fixed, rounded

SAMPLES = 600


def truth_figures(results: Results) -> Html:
    """Table and bars of the comparison, then each target's error along the flight with its claimed sigma."""
    rows = results.comparison
    parts = [_comparison_table(rows), _bars(rows)] if rows else []
    return joined(*parts, _errors(results))


def _comparison_table(rows: tuple[Comparison, ...]) -> Html:
    head = ("error of", "unit", "before", "after", f"claimed 1{SIGMA}", "after, in sigmas", "before / after")
    body = [
        [
            r.what,
            r.unit,
            _or_dash(r.before),
            _or_dash(r.after),
            _or_dash(r.sigma),
            _ratio(r.after, r.sigma),
            _ratio(r.before, r.after),
        ]
        for r in rows
    ]
    return table(head, body, caption="Errors before and after the adjustment", words=2)


def _or_dash(value: float) -> str:
    return rounded(value, 3) if math.isfinite(value) else "\u2013"


def _ratio(value: float, unit: float) -> str:
    if not (math.isfinite(value) and math.isfinite(unit)) or unit == 0:
        return "\u2013"
    ratio = abs(value / unit)
    return fixed(ratio, 1 if ratio < 10 else 0)


def _bars(rows: tuple[Comparison, ...]) -> Html:
    units = list(dict.fromkeys(r.unit for r in rows))
    panels = [p for u in units if (p := _unit_bars(u, [r for r in rows if r.unit == u]))]
    keys = (
        key("bar-before", "before", "M1 6H23"),
        key("bar-after", "after", "M1 6H23"),
        key("bar-claim", f"claimed 1{SIGMA}", "M12 0V12"),
    )
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend")
    return figure(*panels, legend=legend, caption="Logarithmic scales: each step to the left is ten times better.")


def _unit_bars(unit: str, rows: list[Comparison]) -> Html:
    values = [abs(v) for r in rows for v in (r.before, r.after, r.sigma) if math.isfinite(v) and v != 0]
    if not values:
        return Html("")
    low, high = 10 ** math.floor(math.log10(min(values)) - 0.3), 10 ** math.ceil(math.log10(max(values)) + 0.05)
    n, left = len(rows), 150
    p = panel((low, high), (-n + 0.5, 0.5), height=64 + 30 * n, left=left, log_x=True)
    marks = [_bar_pair(r, p.x, p.y.at(-i)) for i, r in enumerate(rows)]
    ticks = [(-float(i), _short(r.what, 21)) for i, r in enumerate(rows)]
    label = f"Errors in {unit} before and after: " + "; ".join(
        f"{r.what} {_or_dash(r.before)} to {_or_dash(r.after)}" for r in rows
    )
    return chart(p, marks, label=label, title=f"In {unit}", x_label=f"error, {unit} (log)", y_ticks=ticks)


def _bar_pair(row: Comparison, x: Scale, y: float) -> Html:
    def at(value: float) -> str | None:
        return f"{x.at(abs(value)):.1f}" if math.isfinite(value) and value != 0 else None

    before, after, claim = at(row.before), at(row.after), at(row.sigma)
    return tag(
        "g",
        tag("path", d=f"M0 {y - 5:.1f}H{before}", class_="bar-before") if before else "",
        tag("path", d=f"M0 {y + 5:.1f}H{after}", class_="bar-after") if after else "",
        tag("path", d=f"M{claim} {y - 1:.1f}V{y + 11:.1f}", class_="bar-claim") if claim else "",
    )


def _short(words: str, most: int) -> str:
    return words if len(words) <= most else words[: most - 1] + "\u2026"


def _errors(results: Results) -> Html:
    pairs = [(t, participants.true_trajectory(results, t.target)) for t in results.trajectories if len(t.time_s) > 1]
    panels = [
        _error_panel(results, participants.thin_trajectory(t, SAMPLES), known)
        for t, known in pairs
        if known is not None
    ]
    if not panels:
        return Html("")
    keys = (key("line", "distance from the truth"), key("band", f"claimed 1{SIGMA} and 2{SIGMA}", "M1 2H23V10H1Z"))
    legend = tag("ul", *(tag("li", k) for k in keys), class_="legend c-ink")
    words = note("A distance stays below the darker band about three times in five if the claim is honest.")
    return joined(tag("h3", "Error along the flight"), figure(*panels, legend=legend), words)


def _error_panel(results: Results, track: Trajectory, known: Trajectory) -> Html:
    true = np.stack(
        [
            np.interp(track.time_s, known.time_s, known.position_enu_m[:, i], left=np.nan, right=np.nan)
            for i in range(3)
        ],
        axis=1,
    )
    error = np.linalg.norm(track.position_enu_m - true, axis=1)
    sigma = track.sigma_m
    good = sigma[np.isfinite(sigma)]
    usual = 2.4 * float(np.median(good)) if len(good) else 0.0
    sure = participants.well_known(results, track)
    seen = error[sure & np.isfinite(error)]
    top = max(float(seen.max(initial=0.0)) * 1.1, usual, 1e-3)
    p = panel(participants.time_span(results), (0.0, top))
    zero = np.zeros_like(sigma)
    marks = [
        band(p, track.time_s, zero, 2 * sigma),
        band(p, track.time_s, zero, sigma),
        known_line(p, track.time_s, error, sure),
    ]
    rms = float(np.sqrt(np.mean(seen**2))) if len(seen) else math.nan
    return chart(
        p, [tag("g", *marks, class_=participants.tone(results, track.target))],
        label=f"Error of {track.target} over time beside its claimed sigma",
        title=f"{track.target}: rms {rounded(rms)} m", x_label="common time, s", y_label="error, m", time=True,
    )  # fmt: skip
