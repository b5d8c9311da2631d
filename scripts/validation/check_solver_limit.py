"""Is `map` at the statistical limit? Its error over the Cramer-Rao bound, and over its own covariance, cell by cell.

usage: python -m scripts.validation.check_solver_limit [--seeds 200] [--jobs 1] [--first-seed 0] [--json]

The flights are those of the paper's section 3.1 (`paper_flight` of the experiments, two UAVs, 50 frames each,
offset 5 frames, told as zero): 1 and 4 targets, order 1 and 2, high and low noise, the second camera's frame rate told
right or 10 % wrong with a prior of 10 %. The bound is computed apart from the solver, from derivatives at the truth.

    RMSE / bound   root mean square of the position's error over all viewpoints and targets, over the same of the bound
    NEES           e' P^-1 e over the number of coefficients, P the covariance that `map` claims; 1: the claim is true

Both stand with their standard error. Exits 1 where a cell is outside.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.flying.answers import answer_of
from pipeline.experiments.flying.bound import bound
from pipeline.experiments.flying.measure import motion_nees, viewpoint_errors
from pipeline.experiments.paper import noise_levels
from pipeline.experiments.paper.scenes import PAPER_RATE_HZ, paper_flight
from pipeline.experiments.running.runner import processes
from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.synthetic.scene import Scene
from pipeline.synthetic.simulate import Noise, simulate
from scripts.validation.figures import tell

MOST_OVER_BOUND, LEAST_NEES, MOST_NEES = 1.08, 0.85, 1.15
RATES_HZ = {"right": PAPER_RATE_HZ, "10 % wrong": 0.9 * PAPER_RATE_HZ}
NOISES = {"high": noise_levels.HIGH, "low": noise_levels.LOW}
SEEDS_PER_JOB = 20


@dataclass(frozen=True, kw_only=True)
class Flown:
    """One cell of the table."""

    targets: int
    order: int
    noise: str
    rate: str

    @property
    def scene(self) -> Scene:
        """What is flown."""
        return _scene(self.order, self.targets, RATES_HZ[self.rate])

    @property
    def drawn(self) -> Noise:
        """What is drawn anew with every seed."""
        return NOISES[self.noise]


@cache
def _scene(order: int, targets: int, given_rate_hz: float) -> Scene:
    """Built once: what is true of it is computed once a scene."""
    return paper_flight(order=order, targets=targets, given_rate_hz=given_rate_hz)


CELLS = tuple(
    Flown(targets=targets, order=order, noise=noise, rate=rate)
    for targets in (1, 4)
    for order in (1, 2)
    for noise in NOISES
    for rate in RATES_HZ
)


@dataclass(frozen=True, kw_only=True)
class Job:
    """Some seeds of one cell: (seeds, 4) of mean square error in m^2, NEES, offset error in sigmas, converged."""

    cell: Flown
    seeds: tuple[int, ...]

    def __call__(self) -> Floats:
        """Fly and measure them."""
        return np.array([self._one(seed) for seed in self.seeds])

    def _one(self, seed: int) -> Floats:
        scene = self.cell.scene
        problem, _ = simulate(scene, noise=self.cell.drawn, seed=seed)
        found = solve(problem, SolverSettings())
        targets = range(len(scene.targets))
        square = [
            float((viewpoint_errors(answer_of(found, problem, n), scene, n) ** 2).sum(axis=1).mean()) for n in targets
        ]
        nees = [motion_nees(found.motions[n], scene, n) for n in targets]
        clock = found.clocks[1]
        off = (clock.offset_s - scene.cameras[1].offset_s) / clock.offset_sigma_s
        return np.array([np.mean(square), np.mean(nees), off, found.status == "converged"])


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table; `*_error` are standard errors."""

    cell: Flown
    bound_m: float
    over_bound: float
    over_bound_error: float
    nees: float
    nees_error: float
    offset_sigmas: float
    converged: int

    @property
    def within(self) -> bool:
        """Whether both figures are what was asked."""
        return self.over_bound <= MOST_OVER_BOUND and LEAST_NEES <= self.nees <= MOST_NEES


def row_of(cell: Flown, runs: Floats) -> Row:
    """From the runs (seeds, 4) of a cell to its line."""
    scene = cell.scene
    limit = bound(scene, cell.drawn)
    least = np.sqrt(np.mean([limit.rms_m(n) ** 2 for n in range(len(scene.targets))]))
    square, nees = runs[:, 0], runs[:, 1]
    rms, root = np.sqrt(square.mean()), np.sqrt(len(runs))
    return Row(
        cell=cell, bound_m=float(least), over_bound=float(rms / least),
        over_bound_error=float(square.std(ddof=1) / root / (2 * rms) / least),
        nees=float(nees.mean()), nees_error=float(nees.std(ddof=1) / root),
        offset_sigmas=float(np.sqrt((runs[:, 2] ** 2).mean())), converged=int(runs[:, 3].sum()),
    )  # fmt: skip


def rows(seeds: range, jobs: int) -> Iterator[Row]:
    """The table, line by line as the cells are done."""
    for cell in CELLS:
        asked = [Job(cell=cell, seeds=tuple(seeds[i : i + SEEDS_PER_JOB])) for i in range(0, len(seeds), SEEDS_PER_JOB)]
        if jobs == 1:
            done = [(i, job()) for i, job in enumerate(asked)]
        else:
            done = sorted(processes(jobs)(asked), key=lambda pair: pair[0])
        yield row_of(cell, np.concatenate([result for _, result in done]))


def main() -> None:
    """Reads the arguments, flies, prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200, help="flights of each cell")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes; the figures do not depend on it")
    parser.add_argument("--json", action="store_true", help="one JSON object a line instead of the table")
    given = parser.parse_args()
    if not given.json:
        print("targets order noise frame rate | bound m  RMSE/bound         NEES               offset/sigma  converged")
    outside, told = 0, []
    for row in rows(range(given.first_seed, given.first_seed + given.seeds), given.jobs):
        outside += not row.within
        told.append(row)
        print(_as_json(row) if given.json else _line(row, given.seeds), flush=True)
    if not given.json:
        print(
            f"{len(CELLS) - outside} of {len(CELLS)} cells within RMSE / bound at most {MOST_OVER_BOUND} and NEES "
            f"{LEAST_NEES} to {MOST_NEES}"
        )
    tell({
        "cells": len(told), "cells_within": len(told) - outside, "flights_a_cell": given.seeds,
        "over_bound": [min(r.over_bound for r in told), max(r.over_bound for r in told)],
        "nees": [min(r.nees for r in told), max(r.nees for r in told)],
    })  # fmt: skip
    sys.exit(int(outside > 0))


def _as_json(row: Row) -> str:
    return json.dumps({**vars(row), "cell": vars(row.cell), "within": row.within})


def _line(row: Row, seeds: int) -> str:
    cell = row.cell
    return (
        f"{cell.targets:7d} {cell.order:5d} {cell.noise:>5} {cell.rate:>10} | {row.bound_m:7.3f}  "
        f"{row.over_bound:.3f} +- {row.over_bound_error:.3f}   {row.nees:.3f} +- {row.nees_error:.3f}     "
        f"{row.offset_sigmas:12.2f}  {row.converged}/{seeds}" + ("" if row.within else "   OUTSIDE")
    )


if __name__ == "__main__":
    main()
