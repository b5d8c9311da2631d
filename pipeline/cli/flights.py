"""The commands that take a flight file: track, poses, solve, run."""

from __future__ import annotations

import json
import re
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.foundation.errors import DID_NOT_CONVERGE, UsageError
from pipeline import stages
from pipeline.cli.console import Console
from pipeline.flight import read_flight

if TYPE_CHECKING:
    from rich.console import RenderableType

    from pipeline.stages import RunSummary

ACTIONS = {"track": "run_track", "poses": "run_poses", "solve": "run_solve", "run": "run_flight"}
"""What each command calls of the stages, of which only that is loaded."""
OFFSET, POSITION = ("camera", "offset_s", "offset_sigma_s"), ("target", "typical_sigma_m")
URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+:/")
"""A URL as pathlib leaves it, with one slash; a Windows drive has one letter."""
FIGURES = ("status", "method", "iterations", "cost", "chi_square", "degrees_of_freedom", "message")


def run(arguments: Namespace, console: Console) -> int:
    """Does what `arguments.command` says; 0, or 7 where the verdict is bad: not converged, or it contradicts itself."""
    check_folder(arguments.output)
    flight, out = read_flight(arguments.flight), arguments.output
    if getattr(arguments, "method", None):
        flight = replace(flight, solve=replace(flight.solve, method=arguments.method))
    if getattr(arguments, "tracker", None):
        flight = replace(flight, cameras=tuple(replace(c, tracker=arguments.tracker) for c in flight.cameras))
    console.detail(f"{arguments.command}: {len(flight.cameras)} cameras, {len(flight.targets)} targets -> {out}")
    action = getattr(stages, ACTIONS[arguments.command])
    more = {"overlay": arguments.overlay} if arguments.command == "track" else {}
    begun_s = console.since_start_s()
    summary = action(flight, out, progress=console.progress, **more)
    for warning in summary.warnings:
        console.say(f"note: {warning}")
    solution = solved_in(out) if arguments.command in ("solve", "run") else None
    report = {**machine_summary(summary, out, solution), "command": arguments.command}
    report["seconds"] = {"start": round(begun_s, 6), **report["seconds"], "total": round(console.since_start_s(), 6)}
    console.result(report, words(report, out, solution))
    return DID_NOT_CONVERGE if solution and solution["verdict"]["grade"] == "bad" else 0


def check_folder(out: Path) -> None:
    """Raises UsageError where a folder is meant to be elsewhere: only a batch writes to URLs."""
    if URL.match(str(out)):
        raise UsageError(
            where="-o",
            seen=f"{out}, a URL",
            expected="a folder of this machine",
            advice="name a folder, or use `runningfix batch`, which writes to URLs",
        )


def solved_in(out: Path) -> dict[str, Any]:
    """The solution that a command left in `out`."""
    found: dict[str, Any] = json.loads((out / "solution.json").read_text())
    return found


def machine_summary(summary: RunSummary, out: Path, solution: Mapping[str, Any] | None) -> dict[str, Any]:
    """The summary that `--json` prints; with what is in `solution` where there is one."""
    found: dict[str, Any] = {"status": "done"}
    if solution:
        found |= {key: solution[key] for key in FIGURES}
        found["findings"] = solution.get("findings", [])
        found["verdict"] = solution["verdict"]
        found["offsets"] = [{key: clock[key] for key in OFFSET} for clock in solution["clocks"]]
        found |= {key: solution[key] for key in ("landmarks", "ground") if key in solution}
        found["positions"] = [{key: m[key] for key in POSITION} for m in solution["motions"]]
    return found | {
        "seconds": {name: round(value, 6) for name, value in summary.seconds.items()},
        "skipped": list(summary.skipped),
        "warnings": list(summary.warnings),
        "files": [str(out / name) for name in summary.files],
    }


def words(report: Mapping[str, Any], out: Path, solution: Mapping[str, Any] | None) -> RenderableType:
    """The same for people."""
    lines = [f"already finished: {', '.join(report['skipped'])}"] if report["skipped"] else []
    lines.append(f"{len(report['files'])} files in {out}")
    if solution and (out / "report.html").exists():
        lines.append(f"look at {out / 'report.html'}")
    text = "\n".join(lines)
    if solution is None:
        return text
    from rich.console import Group

    from pipeline.cli.result import shown

    return Group(shown(solution), "", text)
