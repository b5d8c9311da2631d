"""From single runs to the figures of a table: means with their Monte Carlo error, and what the bound allows.

A mean over runs stands with its standard error. Two approaches solve the same flights, so they are compared run by
run: the mean of the differences stands with the standard error of the differences, which is far smaller than that of
either mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Experiment
from pipeline.experiments.flying.bound import Bound, bound
from pipeline.experiments.flying.flights import cell_scene
from pipeline.experiments.flying.measure import place
from pipeline.experiments.flying.paths import FlownPath

TWO_SIDED = 1.96
"""Standard errors of a 95 % interval."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over runs, its standard error, and the deviation of a single run; NaN where nobody had an answer."""

    mean: float = float("nan")
    error: float = float("nan")
    deviation: float = float("nan")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One approach in one cell.

    runs, solved, converged  how many were flown, had an answer, and said they had converged
    error_m    the paper's measure; median_m its median; rms_m root mean square
    axes_m     (3,) root mean square by axis
    worse_m    this approach's error less the reference's, run by run
    bound_*    what no method can be better than; NaN where there is none
    """

    cell: int
    approach: int
    runs: int
    solved: int
    converged: int
    error_m: Estimate
    worse_m: Estimate
    median_m: float
    rms_m: float
    rms_error_m: float
    axes_m: tuple[float, float, float]
    offset_s: Estimate
    rate: Estimate
    nees: Estimate
    iterations: Estimate
    seconds: Estimate
    solver_seconds: Estimate
    bound_m: float
    bound_rms_m: float
    bound_axes_m: tuple[float, float, float]
    bound_offset_s: float
    bound_rate: float
    published: float

    @property
    def over_bound(self) -> float:
        """Root mean square error over the bound's."""
        return self.rms_m / self.bound_rms_m if self.bound_rms_m > 0 else float("nan")

    @property
    def over_bound_error(self) -> float:
        """Its standard error."""
        return self.rms_error_m / self.bound_rms_m if self.bound_rms_m > 0 else float("nan")

    def against_reference(self) -> str:
        """In a word, beyond the Monte Carlo error: "worse", "better" or "equal"."""
        margin = TWO_SIDED * self.worse_m.error
        if not np.isfinite(self.worse_m.mean):
            return ""
        if abs(self.worse_m.mean) <= margin or abs(self.worse_m.mean) < 1e-9:
            return "equal"
        return "worse" if self.worse_m.mean > 0 else "better"


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """An experiment flown: all runs (cells, runs, approaches, measures), one entry per cell and approach, and paths
    by cell.
    """

    experiment: Experiment
    seed: int
    runs: Floats
    entries: tuple[Entry, ...]
    paths: Mapping[int, FlownPath]

    def entry(self, cell: int, approach: int) -> Entry | None:
        """The entry; None where the approach is left out."""
        return next((e for e in self.entries if (e.cell, e.approach) == (cell, approach)), None)


def estimate(values: Floats) -> Estimate:
    """Mean, its error and the deviation of the finite values among (n,)."""
    good = values[np.isfinite(values)]
    if len(good) == 0:
        return Estimate()
    deviation = float(good.std(ddof=1)) if len(good) > 1 else float("nan")
    return Estimate(mean=float(good.mean()), error=deviation / float(np.sqrt(len(good))), deviation=deviation)


def summarise(
    experiment: Experiment, runs: Floats, seed: int, limits: Mapping[int, Mapping[int, Bound]],
    paths: Mapping[int, FlownPath],
) -> Outcome:  # fmt: skip
    """All entries of an experiment's runs (cells, runs, approaches, measures) and bounds (by cell and approach)."""
    entries = tuple(
        _entry(experiment, c, a, runs[c], limits[c][a]) for c in range(len(experiment.cells)) for a in sorted(limits[c])
    )
    return Outcome(experiment=experiment, seed=seed, runs=runs, entries=entries, paths=paths)


def cell_bounds(experiment: Experiment, cell: int) -> dict[int, Bound]:
    """The bound of a cell for every approach that is not left out: for those who know what the noise truly is."""
    what = experiment.cells[cell]
    shared: dict[bool, Bound] = {}
    out = {}
    for number, approach in enumerate(experiment.approaches):
        if approach.name in what.leave_out:
            continue
        refined = approach.settings.refine_frame_rate
        if refined not in shared:
            shared[refined] = bound(cell_scene(what), what.noise, hidden=what.hidden, refine_frame_rate=refined)
        out[number] = shared[refined]
    return out


def _entry(experiment: Experiment, cell: int, approach: int, runs: Floats, limit: Bound) -> Entry:
    own = runs[:, approach]
    rival = runs[:, experiment.approach(experiment.reference)] if _has_reference(experiment, cell) else own * np.nan
    error, square = own[:, place("error_m")], own[:, place("square_m2")]
    mean_square = estimate(square)
    rms = float(np.sqrt(mean_square.mean))
    axes = [float(np.sqrt(estimate(own[:, place(n)]).mean)) for n in ("east_m2", "north_m2", "up_m2")]
    known = limit.determined
    second = len(limit.unknowns.clock) > 1
    target = experiment.target
    by_axis = limit.rms_by_axis_m(target) if known else np.full(3, np.nan)
    nothing = float("nan")
    return Entry(
        cell=cell, approach=approach, runs=len(own), solved=int(np.isfinite(error).sum()),
        converged=int(own[:, place("converged")].sum()),
        error_m=estimate(error), worse_m=estimate(error - rival[:, place("error_m")]),
        median_m=float(np.median(error[np.isfinite(error)])) if np.isfinite(error).any() else nothing,
        rms_m=rms, rms_error_m=mean_square.error / (2 * rms) if rms > 0 else nothing,
        axes_m=(axes[0], axes[1], axes[2]),
        offset_s=estimate(own[:, place("offset_error_s")]), rate=estimate(own[:, place("rate_error")]),
        nees=estimate(own[:, place("nees")]), iterations=estimate(own[:, place("iterations")]),
        seconds=estimate(own[:, place("seconds")]), solver_seconds=estimate(own[:, place("solver_seconds")]),
        bound_m=limit.mean_m(target) if known else nothing, bound_rms_m=limit.rms_m(target) if known else nothing,
        bound_axes_m=(float(by_axis[0]), float(by_axis[1]), float(by_axis[2])),
        bound_offset_s=limit.offset_sigma_s(1) if known and second else nothing,
        bound_rate=limit.rate_sigma(1) if known and second else nothing,
        published=experiment.cells[cell].published.get(experiment.approaches[approach].name, nothing),
    )  # fmt: skip


def _has_reference(experiment: Experiment, cell: int) -> bool:
    names = [a.name for a in experiment.approaches]
    return experiment.reference in names and experiment.reference not in experiment.cells[cell].leave_out
