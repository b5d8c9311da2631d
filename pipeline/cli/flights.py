"""The commands that take a flight file: track, poses, solve, run."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.foundation.errors import DID_NOT_CONVERGE
from pipeline.cli.console import Console
from pipeline.flight import read_flight
from pipeline.stages import RunSummary, run_flight, run_poses, run_solve, run_track

ACTIONS = {"poses": run_poses, "solve": run_solve, "run": run_flight}
OFFSET, POSITION = ("camera", "offset_s", "offset_sigma_s"), ("target", "typical_sigma_m")
GRADES = {
    "good": "good: nothing speaks against it",
    "care": "care: read the reasons before you rely on it",
    "bad": "BAD: do not use this; every file says so",
}
MARKS = {"good": "-", "care": "!", "bad": "x"}
FIGURES = ("status", "method", "iterations", "cost", "chi_square", "degrees_of_freedom", "message")


def run(arguments: Namespace, console: Console) -> int:
    """Does what `arguments.command` says; 0, or 7 where the verdict is bad: not converged, or it contradicts itself."""
    flight, out = read_flight(arguments.flight), arguments.output
    if getattr(arguments, "method", None):
        flight = replace(flight, solve=replace(flight.solve, method=arguments.method))
    if getattr(arguments, "tracker", None):
        flight = replace(flight, cameras=tuple(replace(c, tracker=arguments.tracker) for c in flight.cameras))
    console.detail(f"{arguments.command}: {len(flight.cameras)} cameras, {len(flight.targets)} targets -> {out}")
    if arguments.command == "track":
        summary = run_track(flight, out, overlay=arguments.overlay, progress=console.progress)
    else:
        summary = ACTIONS[arguments.command](flight, out, progress=console.progress)
    for warning in summary.warnings:
        console.say(f"note: {warning}")
    solved = arguments.command in ("solve", "run")
    report = {**machine_summary(summary, out, solved=solved), "command": arguments.command}
    console.result(report, words(report, out))
    return DID_NOT_CONVERGE if solved and report["verdict"]["grade"] == "bad" else 0


def machine_summary(summary: RunSummary, out: Path, *, solved: bool) -> dict[str, Any]:
    """The summary that `--json` prints."""
    found: dict[str, Any] = {"status": "done"}
    if solved:
        solution = json.loads((out / "solution.json").read_text())
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


def words(report: dict[str, Any], out: Path) -> str:
    """The same for people."""
    lines = []
    if report["status"] != "done":
        lines.append(
            f"{report['method']}: {report['status']} after {report['iterations']} iterations, chi-square "
            f"{report['chi_square']:.1f} for {report['degrees_of_freedom']} degrees of freedom. {report['message']}"
        )
        lines += [f"  {finding['words']}" for finding in report["findings"]]
        lines += verdict_lines(report)
    if report["skipped"]:
        lines.append(f"already finished: {', '.join(report['skipped'])}")
    lines.append(f"{len(report['files'])} files in {out}")
    if (out / "report.html").exists() and report["status"] != "done":
        lines.append(f"look at {out / 'report.html'}")
    return "\n".join(lines)


def verdict_lines(report: dict[str, Any]) -> list[str]:
    """The verdict with its reasons, every offset and every target's typical sigma."""
    lines = [f"verdict    {GRADES[report['verdict']['grade']]}"]
    for reason in report["verdict"]["reasons"]:
        subject = f"{reason['subject']}: " if reason["subject"] and reason["subject"] not in reason["words"] else ""
        lines.append(f"  {MARKS[reason['grade']]} {subject}{reason['words']}")
        if reason["advice"]:
            lines.append(f"    {reason['advice']}")
    for clock in report["offsets"]:
        if clock["offset_sigma_s"] != 0:
            lines.append(
                f"offset     {clock['camera']:<16}{_measured(clock['offset_s'], clock['offset_sigma_s'], 's')}"
            )
    for target in report["positions"]:
        sigma = target["typical_sigma_m"]
        lines.append(f"position   {target['target']:<16}{'unknown' if sigma is None else f'{sigma:.3g} m'} (one sigma)")
    return lines + known_lines(report)


def known_lines(report: dict[str, Any]) -> list[str]:
    """Landmarks and check points against their coordinates, and what the ground is off by."""
    lines = []
    for mark in report.get("landmarks", []):
        word = "check" if mark["kind"] == "check" else "landmark"
        if "off_m" in mark:
            off = math.sqrt(sum(v * v for v in mark["off_m"]))
            told = f"{off:.3g} m from its coordinates ({mark['error_over_sigma']:.2f} sigmas)"
        else:
            sigma = math.sqrt(sum(v * v for v in mark["sigma_m"]))
            told = f"{sigma:.3g} m (one sigma)"
        lines.append(f"{word:<11}{mark['landmark']:<16}{told}, {mark['sightings']} sightings")
    for one in report.get("ground", []):
        lines.append(
            f"ground     {one['target']:<16}{one['off_m']:+.2f} +- {one['sigma_m']:.2f} m from where it was said"
        )
    return lines


def _measured(value: float, sigma: float | None, unit: str) -> str:
    return f"{value:+.6g} {unit}, sigma unknown" if sigma is None else f"{value:+.4f} +- {sigma:.4f} {unit} (one sigma)"
