"""Many runs on many processes, with the same numbers however many there are.

A job is some runs of one cell, or its bound. Every run has its own seed, so jobs may be done anywhere and in any
order; each process computes with one thread, so that sums are always taken in the same order.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Protocol

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Experiment, Path3D
from pipeline.experiments.flying.bound import Bound
from pipeline.experiments.flying.flights import fly, fly_timed
from pipeline.experiments.flying.measure import MEASURES
from pipeline.experiments.flying.paths import FlownPath, fly_path
from pipeline.experiments.paper.catalogue import experiment_named
from pipeline.experiments.statistics.summary import Outcome, cell_bounds, summarise

RUNS_PER_JOB = 10
PATIENCE_S = 0.5
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
Progress = Callable[[str, int, int], None]


class Job(Protocol):
    """A piece of work that can be sent to another process."""

    def __call__(self) -> Any:
        """Do it."""


class Workers(Protocol):
    """Whatever does jobs: yields (number of the job, its result) in any order."""

    def __call__(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Any]]:
        """Do all of them."""


@cache
def warmed(experiment: Experiment, cell: int, seed: int) -> None:
    """Flies once in this process, so that nobody's clock pays for loading."""
    fly(experiment, cell, 0, seed)


@dataclass(frozen=True, kw_only=True)
class Flights:
    """Runs `first` to `first + count` (exclusive) of cell number `cell`: (runs, approaches, measures)."""

    experiment: str
    cell: int
    first: int
    count: int
    seed: int

    def __call__(self) -> Floats:
        """Fly them."""
        experiment = experiment_named(self.experiment)
        runs = range(self.first, self.first + self.count)
        if experiment.timed:
            warmed(experiment, self.cell, self.seed)
            return fly_timed(experiment, self.cell, runs, self.seed)
        return np.stack([fly(experiment, self.cell, run, self.seed) for run in runs])


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The bound of a cell for every approach in it, by its number."""

    experiment: str
    cell: int

    def __call__(self) -> dict[int, Bound]:
        """Compute them."""
        experiment = experiment_named(self.experiment)
        return cell_bounds(experiment, self.cell)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The first run of a cell as a drawing shows it."""

    experiment: str
    cell: int
    seed: int

    def __call__(self) -> FlownPath:
        """Fly it."""
        return fly_path(experiment_named(self.experiment), self.cell, self.seed)


def jobs_of(experiment: Experiment, runs: int, seed: int) -> list[Flights | Limits | Drawn]:
    """All jobs, cell by cell. How many runs a job has says nothing about the numbers."""
    name, cells = experiment.name, range(len(experiment.cells))
    flights = [
        Flights(experiment=name, cell=cell, first=first, count=min(RUNS_PER_JOB, runs - first), seed=seed)
        for cell in cells
        for first in range(0, runs, RUNS_PER_JOB)
    ]
    drawn = [Drawn(experiment=name, cell=d.cell, seed=seed) for d in experiment.drawings if isinstance(d, Path3D)]
    return [*flights, *(Limits(experiment=name, cell=cell) for cell in cells), *drawn]


class Gathering:
    """What comes back of one experiment, in any order, until it is whole."""

    def __init__(self, experiment: Experiment, runs: int, seed: int) -> None:
        self.experiment, self.seed = experiment, seed
        self.jobs = jobs_of(experiment, runs, seed)
        self.total, self.flown, self.left = len(experiment.cells) * runs, 0, len(self.jobs)
        self._runs = np.full((len(experiment.cells), runs, len(experiment.approaches), len(MEASURES)), np.nan)
        self._limits: dict[int, dict[int, Bound]] = {}
        self._paths: dict[int, FlownPath] = {}

    def take(self, job: Flights | Limits | Drawn, result: Any) -> None:
        """Put a job's result in its place."""
        self.left -= 1
        if isinstance(job, Flights):
            self._runs[job.cell, job.first : job.first + job.count] = result
            self.flown += job.count
        elif isinstance(job, Limits):
            self._limits[job.cell] = result
        else:
            self._paths[job.cell] = result

    def outcome(self) -> Outcome:
        """The whole of it."""
        return summarise(self.experiment, self._runs, self.seed, self._limits, self._paths)


def fly_all(
    experiments: Sequence[Experiment], *, runs: int, seed: int, workers: Workers, progress: Progress
) -> Iterator[Outcome]:
    """All runs of the experiments, and what stands beside them: each outcome in its turn, as soon as it is whole.

    The workers are given everything at once, so that they start once and none waits for an experiment's last flight.
    """
    gathered = [Gathering(e, runs, seed) for e in experiments]
    owners = [(g, job) for g in gathered for job in g.jobs]
    results = workers([job for _, job in owners])
    for g in gathered:
        progress(g.experiment.name, g.flown, g.total)
        while g.left:
            number, result = next(results)
            owner, job = owners[number]
            owner.take(job, result)
            if owner is g:
                progress(g.experiment.name, g.flown, g.total)
        yield g.outcome()
    next(results, None)  # lets the workers end by themselves


def perform(job: Job) -> Any:
    """Do a job, in whatever process this is."""
    return job()


def processes(count: int) -> Workers:
    """Jobs done by so many processes of this machine."""
    return partial(_on_processes, count)


def _on_processes(count: int, jobs: Sequence[Job]) -> Iterator[tuple[int, Any]]:
    context = multiprocessing.get_context("spawn")
    with one_thread_each(), ProcessPoolExecutor(count, context, _begin, (os.getpid(),)) as pool:
        running = {pool.submit(perform, job): number for number, job in enumerate(jobs)}
        try:
            for future in as_completed(running):
                yield running.pop(future), future.result()
        except BaseException:  # also where nobody asks for the rest
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def one_thread_each(names: Iterable[str] = ONE_THREAD) -> Iterator[None]:
    """Processes started inside compute with one thread."""
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(before, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _begin(parent: int) -> None:
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    """Ends this process when its parent is gone: a killed run leaves no workers behind."""
    while os.getppid() == parent:
        time.sleep(PATIENCE_S)
    os._exit(1)
