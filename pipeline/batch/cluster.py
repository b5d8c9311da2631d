"""Tasks spread over a Dask cluster (extra `cluster`). Its workers need this package, and reach inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from calibration.foundation import cluster
from pipeline.batch.flying import Flown, Task, fly_here
from pipeline.batch.spread import Spread


def on_cluster(address: str) -> Spread:
    """The cluster of the scheduler at `address`."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, tasks: Sequence[Task]) -> Iterator[tuple[Task, Flown]]:
    for number, flown in cluster.on_cluster(address, fly_here, tasks):
        yield tasks[number], flown
