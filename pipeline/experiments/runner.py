"""Many runs on many processes, with the same numbers however many there are.

A task is some runs of one cell. Every run has its own seed, so tasks may be done anywhere and in any order; each
process computes with one thread, so that sums are always taken in the same order.
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
from functools import partial
from typing import Protocol

import numpy as np

from calibration.arrays import Floats
from pipeline.experiments.catalogue import experiment_named
from pipeline.experiments.flights import fly
from pipeline.experiments.measure import MEASURES

RUNS_PER_TASK = 10
PATIENCE_S = 0.5
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Task:
    """Runs `first` to `first + count` (exclusive) of cell number `cell`."""

    experiment: str
    cell: int
    first: int
    count: int
    seed: int


class Workers(Protocol):
    """Whatever does tasks: yields (number of the task, its result) in any order."""

    def __call__(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Floats]]:
        """Do all of them."""


def do_task(task: Task) -> Floats:
    """(runs, approaches, measures)."""
    experiment = experiment_named(task.experiment)
    if experiment.timed:
        fly(experiment, task.cell, task.first, task.seed)  # so that nobody's clock pays for loading
    runs = range(task.first, task.first + task.count)
    return np.stack([fly(experiment, task.cell, run, task.seed) for run in runs])


def tasks_of(name: str, cells: int, runs: int, seed: int) -> list[Task]:
    """All tasks, cell by cell. How many runs a task has says nothing about the numbers."""
    return [
        Task(experiment=name, cell=cell, first=first, count=min(RUNS_PER_TASK, runs - first), seed=seed)
        for cell in range(cells)
        for first in range(0, runs, RUNS_PER_TASK)
    ]


def fly_all(name: str, *, runs: int, seed: int, workers: Workers, progress: Progress) -> Floats:
    """(cells, runs, approaches, measures) of an experiment."""
    experiment = experiment_named(name)
    tasks = tasks_of(name, len(experiment.cells), runs, seed)
    out = np.full((len(experiment.cells), runs, len(experiment.approaches), len(MEASURES)), np.nan)
    done, total = 0, len(experiment.cells) * runs
    progress(name, 0, total)
    for number, result in workers(tasks):
        task = tasks[number]
        out[task.cell, task.first : task.first + task.count] = result
        done += task.count
        progress(name, done, total)
    return out


def processes(jobs: int) -> Workers:
    """Tasks done by `jobs` processes of this machine."""
    return partial(_on_processes, jobs)


def _on_processes(jobs: int, tasks: Sequence[Task]) -> Iterator[tuple[int, Floats]]:
    context = multiprocessing.get_context("spawn")
    with one_thread_each(), ProcessPoolExecutor(jobs, context, _begin, (os.getpid(),)) as pool:
        running = {pool.submit(do_task, task): number for number, task in enumerate(tasks)}
        try:
            for future in as_completed(running):
                yield running.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


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
