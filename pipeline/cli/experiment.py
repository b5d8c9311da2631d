"""`runningfix experiment`: the paper's tables and figures, flown again."""

from __future__ import annotations

import math
import time
from argparse import Namespace
from collections.abc import Mapping
from typing import Any

from calibration.foundation.errors import UsageError
from pipeline.cli.console import Console
from pipeline.experiments import (
    EXPERIMENTS,
    Entry,
    Outcome,
    cluster,
    experiment_named,
    processes,
    run_experiments,
    sentence,
    verdict,
    write_outcome,
)

LIST, ALL = "list", "all"


def run(arguments: Namespace, console: Console) -> int:
    """Lists, or flies one experiment or all of them, and says where the pages are."""
    if arguments.name == LIST:
        rows = {name: experiment_named(name) for name in EXPERIMENTS}
        text = "\n".join(f"{name:<14}{e.paper or 'ours':<20}{e.title}" for name, e in rows.items())
        summary = {n: {"paper": e.paper, "title": e.title, "cells": len(e.cells)} for n, e in rows.items()}
        console.result({"status": "ok", "command": "experiment", "experiments": summary}, text)
        return 0
    for option, value in (("--runs", arguments.runs), ("--jobs", arguments.jobs)):
        if value < 1:
            raise UsageError(where=option, seen=str(value), expected="1 or more", advice=f"{option} 2")
    names = list(EXPERIMENTS) if arguments.name == ALL else [experiment_named(arguments.name).name]
    workers = cluster(arguments.scheduler) if arguments.scheduler else processes(arguments.jobs)
    found: list[Outcome] = []
    files: list[str] = []
    seconds: dict[str, float] = {}
    began = time.perf_counter()
    for outcome in run_experiments(
        names, runs=arguments.runs, seed=arguments.seed, workers=workers, progress=console.progress
    ):
        files += write_outcome(outcome, arguments.output)
        seconds[outcome.experiment.name] = round(time.perf_counter() - began, 3)
        found.append(outcome)
        began = time.perf_counter()
    result: dict[str, Any] = {
        "status": "ok", "command": "experiment", "runs": arguments.runs, "seed": arguments.seed, "seconds": seconds,
        "files": files,
        "verdict": {o.experiment.name: _verdict(o) for o in found},
        "entries": [_row(o, e) for o in found for e in o.entries],
    }  # fmt: skip
    shown = "\n\n".join(_table(o) for o in found)
    pages = "\n".join(f"look at {arguments.output / f}" for f in files if f.endswith(".html"))
    took = "seconds: " + ", ".join(f"{name} {value:.0f}" for name, value in seconds.items())
    console.result(result, f"{shown}\n\n{took}\n{pages}")
    return 0


def _verdict(outcome: Outcome) -> Mapping[str, Any]:
    v = verdict(outcome)
    return {"better": v.better, "equal": v.equal, "worse": len(v.worse), "missed": len(v.missed)}


def _row(outcome: Outcome, e: Entry) -> Mapping[str, Any]:
    row: dict[str, Any] = {
        "experiment": outcome.experiment.name,
        "cell": dict(outcome.experiment.cells[e.cell].values),
        "approach": outcome.experiment.approaches[e.approach].name,
        "solved": e.solved,
        "against_reference": e.against_reference(),
    }
    figures = {
        "error_m": e.error_m.mean, "standard_error_m": e.error_m.error, "bound_m": e.bound_m,
        "rms_over_bound": e.over_bound, "nees": e.nees.mean, "published": e.published,
    }  # fmt: skip
    return row | {k: (v if math.isfinite(v) else None) for k, v in figures.items()}


def _table(outcome: Outcome) -> str:
    """For people: a line for every cell and approach, the paper's figure beside ours, and the verdict."""
    e = outcome.experiment
    seconds = ("solve s",) if e.timed else ()
    names = ("error m", "+-", "bound", "rms/bound", *seconds, "paper")
    lines = [f"{e.name}: {e.title}", f"{'cell':<52}{'approach':<32}" + "".join(f"{n:>11}" for n in names)]
    for entry in outcome.entries:
        cell = ", ".join(f"{k} {v}" for k, v in e.cells[entry.cell].values.items())
        figures = [entry.error_m.mean, entry.error_m.error, entry.bound_m, entry.over_bound]
        figures += [entry.solver_seconds.mean] * e.timed + [entry.published]
        texts = "".join(f"{v:>11.4g}" if math.isfinite(v) else " " * 11 for v in figures)
        mark = f"  better than {e.reference}" if entry.against_reference() == "better" else ""
        lines.append(f"{cell:<52}{e.approaches[entry.approach].name:<32}{texts}{mark}")
    return "\n".join([*lines, sentence(outcome)])
