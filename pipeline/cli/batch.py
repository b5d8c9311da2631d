"""`runningfix batch`: many flights, each in limits, into one data set."""

from __future__ import annotations

import math
import os
from argparse import Namespace
from typing import Any

from calibration.foundation.errors import DID_NOT_CONVERGE, UsageError
from pipeline.batch import (
    BatchSummary,
    FlightOutcome,
    Limits,
    find_flights,
    memory_bytes,
    on_cluster,
    on_processes,
    run_batch,
    share_of_memory,
)
from pipeline.cli.console import Console

ORDER = ("done", "good", "care", "bad", "failed", "timeout", "memory", "crashed")
MOST_SHOWN = 20
"""Flights named on the screen at the end; the page and the catalogue have all."""


def run(arguments: Namespace, console: Console) -> int:
    """Does all flights; 0 where each has results that may be used, else 7."""
    jobs = arguments.jobs if arguments.jobs is not None else os.cpu_count() or 1
    _check(arguments, jobs)
    limits = Limits(
        time_s=arguments.timeout,
        memory_bytes=share_of_memory(jobs) if arguments.memory is None else memory_bytes(arguments.memory),
    )
    flights = find_flights(arguments.flights)
    console.detail(f"batch: {len(flights)} flights -> {arguments.output}")
    spread = on_cluster(arguments.scheduler) if arguments.scheduler else on_processes(jobs)

    def tell(outcome: FlightOutcome) -> None:
        if outcome.status != "done":
            console.say(f"{outcome.name}: {outcome.status}. {line(outcome)}")

    summary = run_batch(
        flights, arguments.output, spread, limits=limits, again=arguments.again, progress=console.progress, tell=tell
    )
    for note in summary.notes:
        console.say(f"note: {note}")
    code = 0 if all(o.status == "done" and o.verdict != "bad" for o in summary.outcomes) else DID_NOT_CONVERGE
    console.result(_plain(summary, arguments.output, code), words(summary, arguments.output))
    return code


def _check(arguments: Namespace, jobs: int) -> None:
    if jobs < 1:
        raise UsageError(where="--jobs", seen=str(jobs), expected="1 or more", advice="--jobs 2")
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0):
        raise UsageError(
            where="--timeout", seen=str(arguments.timeout), expected="seconds above 0", advice="--timeout 600"
        )


def _plain(summary: BatchSummary, out: str, code: int) -> dict[str, Any]:
    kept = ("name", "source", "status", "verdict", "seconds", "exit_code", "error")
    return {
        "status": "done",
        "command": "batch",
        "exit_code": code,
        "flights": [{key: getattr(o, key) for key in kept} for o in summary.outcomes],
        "count": summary.count(),
        "skipped": list(summary.found_finished),
        "seconds": {"batch": round(summary.seconds, 3), "flights": round(sum(o.seconds for o in summary.outcomes), 3)},
        "warnings": list(summary.notes),
        "files": [f"{out.rstrip('/')}/{name}" for name in ("catalogue.parquet", "index.html")],
    }


def words(summary: BatchSummary, out: str) -> str:
    """The same for people."""
    count = summary.count()
    lines = [f"{len(summary.outcomes)} flights: " + ", ".join(f"{count[k]} {k}" for k in ORDER if k in count)]
    lines += [f"  {o.name}: {o.verdict or o.status}" for o in _doubtful(summary)[:MOST_SHOWN]]
    if len(_doubtful(summary)) > MOST_SHOWN:
        lines.append(f"  and {len(_doubtful(summary)) - MOST_SHOWN} more")
    if summary.found_finished:
        lines.append(f"already finished: {len(summary.found_finished)}")
    lines.append(f"look at {out.rstrip('/')}/index.html; every figure is in catalogue.parquet beside it")
    return "\n".join(lines)


def _doubtful(summary: BatchSummary) -> list[FlightOutcome]:
    return [o for o in summary.outcomes if o.status != "done" or o.verdict == "bad"]


def line(outcome: FlightOutcome) -> str:
    """What stopped a flight, in the four parts."""
    e = outcome.error
    return f"{e['where']}: {e['seen']}; expected {e['expected']}. Try: {e['advice']}" if e else ""
