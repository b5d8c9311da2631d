"""The same work on a Dask cluster, for more than one machine can do (extra `cluster`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from calibration.foundation.errors import UsageError

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def on_cluster(address: str, function: Callable[[Item], Answer], items: Sequence[Item]) -> Iterator[tuple[int, Answer]]:
    """The number of each item and the function's answer, as they come, from the scheduler's workers at `address`.

    The workers need this package. Raises UsageError without a Dask client or a scheduler, and what `function` raises.
    """
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
        futures = client.map(function, list(items), pure=False)
        number = {future.key: i for i, future in enumerate(futures)}
        for future in as_completed(futures, loop=client.loop):
            yield number[future.key], future.result()
            future.release()
