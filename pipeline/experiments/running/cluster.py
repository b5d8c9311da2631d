"""The same jobs on a Dask cluster, for more runs than one machine can do (extra `runningfix[cluster]`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from calibration.foundation.errors import UsageError
from pipeline.experiments.running.runner import Job, Workers, perform


def cluster(address: str) -> Workers:
    """Jobs done by the workers of the scheduler at `address`; they need this package, and one thread each."""
    return partial(_on_cluster, address)


def _on_cluster(address: str, jobs: Sequence[Job]) -> Iterator[tuple[int, Any]]:
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
        futures = client.map(perform, list(jobs), pure=False)
        number = {future.key: i for i, future in enumerate(futures)}
        for future, result in as_completed(futures, loop=client.loop, with_results=True):
            yield number[future.key], result
            future.release()
