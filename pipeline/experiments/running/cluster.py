"""The same jobs on a Dask cluster, for more runs than one machine can do (extra `runningfix[cluster]`)."""

from __future__ import annotations

from functools import partial

from calibration.foundation.cluster import on_cluster
from pipeline.experiments.running.runner import Workers, perform


def cluster(address: str) -> Workers:
    """Jobs done by the workers of the scheduler at `address`; they need this package, and one thread each."""
    return partial(on_cluster, address, perform)
