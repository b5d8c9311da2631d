"""`runningfix check`: what can be seen of a flight before an hour of tracking."""

from __future__ import annotations

import math
import time
from argparse import Namespace
from typing import Any

from pipeline.cli.console import Console
from pipeline.flight import read_flight
from pipeline.stages import Outlook, check_flight


def run(arguments: Namespace, console: Console) -> int:
    """Says what is wrong or doubtful; the exit code of what the other commands would refuse, else 0."""
    begin = time.perf_counter()
    flight = read_flight(arguments.flight)
    found = check_flight(flight, console.progress)
    stops = [*found.errors, *(doubt.error() for doubt in found.doubts if doubt.certain)]
    code = stops[0].exit_code if stops else 0
    summary = {**_plain(found), "exit_code": code, "seconds": {"check": round(time.perf_counter() - begin, 3)}}
    console.result({"status": "error" if stops else "done", "command": "check", **summary}, words(found))
    return code


def _plain(found: Outlook) -> dict[str, Any]:
    """The outlook as JSON has it."""
    doubts = [
        {
            "kind": d.kind, "subject": list(d.subject), "certain": d.certain, "where": d.where, "seen": d.seen,
            "expected": d.expected, "advice": d.advice,
        }
        for d in found.doubts
    ]  # fmt: skip
    errors = [
        {"exit_code": e.exit_code, "where": e.where, "seen": e.seen, "expected": e.expected, "advice": e.advice}
        for e in found.errors
    ]
    expected = [
        {"target": e.target, "sigma_m": e.sigma_m, "angle_deg": math.degrees(e.angle_rad)} for e in found.expected
    ]
    warnings = [doubt.words for doubt in found.doubts if not doubt.certain]
    return {"errors": errors, "doubts": doubts, "expected": expected, "warnings": warnings, "files": []}


def words(found: Outlook) -> str:
    """The same for people."""
    lines = [f"refused   {error}" for error in found.errors]
    lines += [f"{'refused' if doubt.certain else 'doubtful':<10}{doubt.words}" for doubt in found.doubts]
    for one in found.expected:
        sigma = f"{one.sigma_m:.2g} m" if math.isfinite(one.sigma_m) else "not to be known"
        lines.append(
            f"expected  {one.target}: {sigma} at its first boxes (one sigma per axis), seen from directions "
            f"{math.degrees(one.angle_rad):.0f} degrees apart"
        )
    if not found.errors and not found.doubts:
        lines.append("nothing speaks against this flight")
    return "\n".join(lines)
