"""The measures that tables and curves show, by name: value, its standard error, the bound, and how to write them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.experiments.flying.measure import place
from pipeline.experiments.statistics.ratios import Ratio, of_means, of_medians
from pipeline.experiments.statistics.summary import Entry, Outcome

FRAME_S = 0.1
NOTHING = float("nan")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One number of a table: value, its standard error or 95 % interval, deviation of a single run, bound, published
    number.
    """

    value: float
    error: float = NOTHING
    low: float = NOTHING
    high: float = NOTHING
    deviation: float = NOTHING
    bound: float = NOTHING
    published: float = NOTHING


def figure_of(outcome: Outcome, entry: Entry, measure: str) -> Figure:
    """The figure of one entry. Raises KeyError for an unknown measure."""
    return FIGURES[measure](outcome, entry)


def _error(outcome: Outcome, e: Entry) -> Figure:
    return Figure(
        value=e.error_m.mean,
        error=e.error_m.error,
        deviation=e.error_m.deviation,
        bound=e.bound_m,
        published=e.published,
    )


def _offset(outcome: Outcome, e: Entry) -> Figure:
    o = e.offset_s
    return Figure(value=o.mean / FRAME_S, error=o.error / FRAME_S, deviation=o.deviation / FRAME_S)


def _offset_rms(outcome: Outcome, e: Entry) -> Figure:
    off = outcome.runs[e.cell, :, e.approach, place("offset_error_s")] / FRAME_S
    square = off[np.isfinite(off)] ** 2
    rms = float(np.sqrt(square.mean()))
    error = float(square.std() / np.sqrt(len(square))) / (2 * rms)
    return Figure(value=rms, error=error, bound=e.bound_offset_s / FRAME_S)


def _over_bound(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.over_bound, error=e.over_bound_error)


def _nees(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.nees.mean, error=e.nees.error)


def _iterations(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.iterations.mean, error=e.iterations.error)


def _seconds(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.seconds.mean, error=e.seconds.error)


def _solver_seconds(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.solver_seconds.mean, error=e.solver_seconds.error, published=e.published)


def _solved(outcome: Outcome, e: Entry) -> Figure:
    return Figure(value=e.solved / e.runs)


def _ratio(found: Ratio) -> Figure:
    return Figure(value=found.value, low=found.low, high=found.high, bound=found.bound, published=found.published)


def _over(base: str) -> Callable[[Outcome, Entry], Figure]:
    return lambda outcome, entry: _ratio(of_means(outcome, entry, base))


def _median_over_algorithm_1(outcome: Outcome, entry: Entry) -> Figure:
    return _ratio(of_medians(outcome, entry, "Algorithm 1"))


def _quicker_than(base: str) -> Callable[[Outcome, Entry], Figure]:
    """Seconds of the base over those of the approach; the paper's where it prints both."""

    def figure(outcome: Outcome, entry: Entry) -> Figure:
        found = of_means(outcome, entry, base, "solver_seconds")
        return Figure(value=1 / found.value, low=1 / found.high, high=1 / found.low, published=1 / found.published)

    return figure


FIGURES: dict[str, Callable[[Outcome, Entry], Figure]] = {
    "error_m": _error,
    "offset_frames": _offset,
    "offset_rms_frames": _offset_rms,
    "over_bound": _over_bound,
    "over_algorithm_1": _over("Algorithm 1"),
    "over_algorithm_2": _over("Algorithm 2"),
    "median_over_algorithm_1": _median_over_algorithm_1,
    "nees": _nees,
    "iterations": _iterations,
    "seconds": _seconds,
    "solver_seconds": _solver_seconds,
    "quicker_than_plain": _quicker_than("Li, plain"),
    "quicker_than_plain_to_the_end": _quicker_than("Li, plain, to the end"),
    "quicker_than_li": _quicker_than("Li"),
    "quicker_than_li_to_the_end": _quicker_than("Li, to the end"),
    "solved_share": _solved,
}


def words(value: float, digits: int = 3) -> str:
    """A number for people; an en dash where there is none."""
    if not math.isfinite(value):
        return "\u2013"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.1e}".replace("-", "\u2212")
    text = f"{value:#.{digits}g}" if abs(value) < 1000 else f"{value:.0f}"
    return text.rstrip(".").replace("-", "\u2212")
