"""The clocks: when each camera started, how fast it runs, where it drifts, and how sure the search was."""

from __future__ import annotations

import math

import numpy as np

from pipeline.records import Clock, Results, Solution
from pipeline.report.blocks import figure, note, table
from pipeline.report.charts.axes import span
from pipeline.report.charts.plot import band, chart, level, line, panel
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.text.words import SIGMA, fixed, plus_minus, rounded
from pipeline.report.views.summary import reference_clock

MOST = 12


def timing(results: Results) -> Html:
    """Table of clocks, drift plots, candidates of the global search."""
    solution = results.solution
    return joined(_clock_table(solution), _drifts(results), _candidates(solution))


def _clock_table(solution: Solution) -> Html:
    reference = reference_clock(solution)
    head = ("camera", "clock", "frame 0 at, s", "given, Hz", "refined, Hz", "runs fast by, ppm")
    rows = [_clock_row(c, c is reference) for c in solution.clocks]
    words = f"Common time is the clock of {reference.camera}. " if reference else ""
    explained = f"{words}Frame f was taken at f / frame rate + offset; {SIGMA} is one standard deviation."
    return joined(table(head, rows, caption="Clocks of the cameras", words=2), note(explained))


def _clock_row(clock: Clock, is_reference: bool) -> list[str]:
    kind = "reference, held" if is_reference else "drifts" if clock.deviation_s is not None else "steady"
    held = clock.frame_rate_sigma == 0
    ppm = 1e6 * (clock.frame_rate / clock.nominal_rate - 1)
    ppm_sigma = 1e6 * clock.frame_rate_sigma / clock.nominal_rate
    return [
        clock.camera,
        kind,
        "0 (held)" if is_reference else plus_minus(clock.offset_s, clock.offset_sigma_s),
        rounded(clock.nominal_rate, 6),
        "held" if held else plus_minus(clock.frame_rate, clock.frame_rate_sigma),
        "" if held else plus_minus(ppm, ppm_sigma),
    ]


def _drifts(results: Results) -> Html:
    drifting = [c for c in results.solution.clocks if c.deviation_s is not None and c.deviation_frame is not None]
    if not drifting:
        return Html("")
    panels = [_drift(c) for c in drifting]
    return joined(tag("h3", "Drift"), figure(*panels, caption=f"Deviation from an even clock, with its 2{SIGMA} band."))


def _drift(clock: Clock) -> Html:
    assert clock.deviation_frame is not None
    assert clock.deviation_s is not None
    time = clock.deviation_frame / clock.frame_rate + clock.offset_s
    ms = 1e3 * clock.deviation_s
    sigma = np.zeros_like(ms) if clock.deviation_sigma_s is None else 1e3 * np.nan_to_num(clock.deviation_sigma_s)
    p = panel(
        (float(time[0]), float(max(time[-1], time[0] + 1e-6))),
        span(ms - 2 * sigma, ms + 2 * sigma, np.zeros(1), least=0.1),
    )
    marks = [level(p, 0.0), band(p, time, ms - 2 * sigma, ms + 2 * sigma), line(p, time, ms)]
    return chart(
        p, [tag("g", *marks, class_="c-ink")], label=f"Clock of {clock.camera}: deviation from an even clock over time",
        title=clock.camera, x_label="common time, s", y_label="deviation, ms", time=True,
    )  # fmt: skip


def _candidates(solution: Solution) -> Html:
    found = sorted(solution.offset_candidates, key=lambda c: c.cost)[:MOST]
    if len(found) < 2:
        return Html("")
    order = {c.camera: i for i, c in enumerate(solution.clocks)}
    names = sorted({n for c in found for n in c.offset_s}, key=lambda n: (order.get(n, len(order)), n))
    head = ("rank", *(f"{n}, s" for n in names), "cost", "chi-square above the best")
    best = found[0].cost
    rows = [
        [
            "best" if i == 0 else f"{i + 1}.",
            *(fixed(c.offset_s.get(n, math.nan), 2) for n in names),
            rounded(c.cost, 5),
            "0" if i == 0 else _worse(2 * (c.cost - best)),
        ]
        for i, c in enumerate(found)
    ]
    explained = "A difference in chi-square of 25 is five sigmas: beyond it the second answer can be ruled out."
    return joined(
        tag("h3", "What the global search of offsets found"),
        table(head, rows, caption="Sets of offsets that fit best"),
        note(explained),
    )


def _worse(chi_square: float) -> Html | str:
    sure = "doubtful" if chi_square < 25 else "ruled out"
    return joined(f"{rounded(chi_square, 3)} ", tag("small", f"({sure})"))
