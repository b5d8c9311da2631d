"""Tasks spread over this machine: so many workers, each kept by a thread that waits for it."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from typing import Protocol

from pipeline.batch.flying import Flown, Task, fly
from pipeline.batch.kept import KeptWorker


class Spread(Protocol):
    """Whatever does tasks: yields each with what came of it, in any order."""

    def __call__(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Flown]]:
        """Do all of them."""


def on_processes(jobs: int) -> Spread:
    """So many processes of this machine."""
    return partial(_on_processes, jobs)


def _on_processes(jobs: int, tasks: Sequence[Task]) -> Iterator[tuple[Task, Flown]]:
    workers: list[KeptWorker] = []
    mine = threading.local()

    def do(task: Task) -> Flown:
        if not hasattr(mine, "worker"):
            mine.worker = KeptWorker()
            workers.append(mine.worker)
        return fly(task, mine.worker)

    pool = ThreadPoolExecutor(min(jobs, max(1, len(tasks))))
    try:
        running = {pool.submit(do, task): task for task in tasks}
        for future in as_completed(running):
            yield running[future], future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.stop()
        pool.shutdown(wait=True)
