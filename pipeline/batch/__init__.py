"""Many flights, each in limits, into one data set: `run_batch`.

    names of flight files ─► which flights ─► one flight (fetched, run by a kept worker, brought home) ─► data set, page

A flight that fails, hangs or needs too much is a row that says so; the others go on. What is finished stays.
"""

from pipeline.batch.cluster import on_cluster
from pipeline.batch.limits import Limits, memory_bytes, share_of_memory
from pipeline.batch.outcome import STATUSES, FlightOutcome
from pipeline.batch.run import BatchSummary, run_batch
from pipeline.batch.spread import on_processes
from pipeline.batch.which import NamedFlight, find_flights

__all__ = [
    "STATUSES",
    "BatchSummary",
    "FlightOutcome",
    "Limits",
    "NamedFlight",
    "find_flights",
    "memory_bytes",
    "on_cluster",
    "on_processes",
    "run_batch",
    "share_of_memory",
]
