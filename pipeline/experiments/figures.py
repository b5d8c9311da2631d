"""The measures that tables and curves show, by name: value, its standard error, the bound, and how to write them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.experiments.measure import place
from pipeline.experiments.summary import Entry, Outcome

FRAME_S = 0.1
NOTHING = float("nan")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One number of a table: value, standard error, deviation of a single run, bound, the published number."""

    value: float
    error: float = NOTHING
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


def _over_algorithm_1(outcome: Outcome, e: Entry) -> Figure:
    """Ratio of mean errors; its standard error from the paired runs (delta method)."""
    base = outcome.experiment.approach("Algorithm 1")
    mine = outcome.runs[e.cell, :, e.approach, place("error_m")]
    theirs = outcome.runs[e.cell, :, base, place("error_m")]
    both = np.isfinite(mine) & np.isfinite(theirs)
    mine, theirs = mine[both], theirs[both]
    if len(mine) < 2:
        return Figure(value=NOTHING)
    ratio = float(mine.mean() / theirs.mean())
    error = float((mine - ratio * theirs).std(ddof=1) / np.sqrt(len(mine)) / theirs.mean())
    names = outcome.experiment.approaches
    printed = outcome.experiment.cells[e.cell].published
    published = printed.get(names[e.approach].name, NOTHING) / printed.get("Algorithm 1", NOTHING)
    return Figure(value=ratio, error=error, published=published, bound=e.bound_m / float(theirs.mean()))


def _median_over_algorithm_1(outcome: Outcome, e: Entry) -> Figure:
    """Ratio of the median errors: of typical flights, where single ones go far astray."""
    base = outcome.entry(e.cell, outcome.experiment.approach("Algorithm 1"))
    names = outcome.experiment.approaches
    printed = outcome.experiment.cells[e.cell].published
    published = printed.get(names[e.approach].name, NOTHING) / printed.get("Algorithm 1", NOTHING)
    typical = NOTHING if base is None else base.median_m
    return Figure(value=e.median_m / typical, published=published, bound=e.bound_m / typical)


FIGURES: dict[str, Callable[[Outcome, Entry], Figure]] = {
    "error_m": _error,
    "offset_frames": _offset,
    "offset_rms_frames": _offset_rms,
    "over_bound": _over_bound,
    "over_algorithm_1": _over_algorithm_1,
    "median_over_algorithm_1": _median_over_algorithm_1,
    "nees": _nees,
    "iterations": _iterations,
    "seconds": _seconds,
    "solver_seconds": _solver_seconds,
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
