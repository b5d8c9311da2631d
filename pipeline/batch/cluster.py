"""Tasks spread over a Dask cluster (extra `cluster`). Its workers need this package, and reach inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from calibration.foundation.errors import UsageError
from pipeline.batch.flying import Flown, Task, fly_here
from pipeline.batch.spread import Spread


def on_cluster(address: str) -> Spread:
    """The cluster of the scheduler at `address`."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, tasks: Sequence[Task]) -> Iterator[tuple[Task, Flown]]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise UsageError(
            where="--scheduler", seen="the package 'distributed' is not installed", expected="a Dask client",
            advice="pip install 'runningfix[cluster]'",
        ) from None  # fmt: skip
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            where="--scheduler", seen=f"nothing answers at {address} ({error})",
            expected="the address of a Dask scheduler, such as tcp://127.0.0.1:8786", advice="dask scheduler",
        ) from None  # fmt: skip
    with client:
        futures = client.map(fly_here, list(tasks), pure=False)
        task_of = {future.key: task for future, task in zip(futures, tasks, strict=True)}
        for future in as_completed(futures, loop=client.loop):
            yield task_of[future.key], future.result()
            future.release()
