"""One approach over another on the same flights, with a 95 % interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.flying.measure import place
from pipeline.experiments.statistics.summary import TWO_SIDED, Entry, Outcome

RESAMPLED = 400
NOTHING = float("nan")


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """A ratio, the ends of its 95 % interval, the ratio that the bound allows, and the paper's."""

    value: float = NOTHING
    low: float = NOTHING
    high: float = NOTHING
    bound: float = NOTHING
    published: float = NOTHING


def of_means(outcome: Outcome, entry: Entry, base: str, measure: str = "error_m") -> Ratio:
    """Mean of a measure over the base's; the interval from the paired runs (delta method)."""
    mine, theirs = _pairs(outcome, entry, base, measure)
    if len(mine) < 2:
        return Ratio()
    ratio = float(mine.mean() / theirs.mean())
    error = float((mine - ratio * theirs).std(ddof=1) / np.sqrt(len(mine)) / theirs.mean())
    limit = entry.bound_m / float(theirs.mean()) if measure == "error_m" else NOTHING
    return Ratio(
        value=ratio, low=ratio - TWO_SIDED * error, high=ratio + TWO_SIDED * error, bound=limit,
        published=published_ratio(outcome, entry, base),
    )  # fmt: skip


def of_medians(outcome: Outcome, entry: Entry, base: str) -> Ratio:
    """Median error over the base's: of typical flights, where single ones go far astray; a paired bootstrap."""
    mine, theirs = _pairs(outcome, entry, base, "error_m")
    if len(mine) < 2:
        return Ratio()
    drawn = np.random.default_rng(0).integers(len(mine), size=(RESAMPLED, len(mine)))
    low, high = np.quantile(np.median(mine[drawn], axis=1) / np.median(theirs[drawn], axis=1), [0.025, 0.975])
    typical = float(np.median(theirs))
    return Ratio(
        value=float(np.median(mine)) / typical, low=float(low), high=float(high), bound=entry.bound_m / typical,
        published=published_ratio(outcome, entry, base),
    )  # fmt: skip


def published_ratio(outcome: Outcome, entry: Entry, base: str) -> float:
    """The paper's figure over its figure for the base."""
    printed = outcome.experiment.cells[entry.cell].published
    own = printed.get(outcome.experiment.approaches[entry.approach].name, NOTHING)
    return own / printed.get(base, NOTHING)


def _pairs(outcome: Outcome, entry: Entry, base: str, measure: str) -> tuple[Floats, Floats]:
    """(n,) both approaches' figures of the runs in which both have an answer."""
    runs = outcome.runs[entry.cell, :, :, place(measure)]
    mine, theirs = runs[:, entry.approach], runs[:, outcome.experiment.approach(base)]
    both = np.isfinite(mine) & np.isfinite(theirs)
    return mine[both], theirs[both]
