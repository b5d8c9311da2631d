"""`runningfix doctor`: is this installation whole."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version

from pipeline.cli.console import Console
from pipeline.doctor import Finding, Trial, findings, tried
from pipeline.solver import make_ready

BROKEN = 1


def run(arguments: Namespace, console: Console) -> int:
    """0 where nothing is wrong, else 1; what is wrong is said with what mends it."""
    if arguments.warm:
        make_ready(lambda done, total: console.progress("compile", done, total))
    found = findings()
    trials = tried(console.progress) if not arguments.quick else ()
    broken = any(one.state == "wrong" for one in found) or not all(one.right for one in trials)
    summary = {
        "status": "error" if broken else "done",
        "command": "doctor",
        "version": version("runningfix"),
        "installation": [asdict(one) for one in found],
        "self_test": [asdict(one) for one in trials],
        "warnings": [f"{one.name}: {one.seen}" for one in found if one.state == "absent"],
        "files": [],
        "exit_code": BROKEN if broken else 0,
    }
    console.result(summary, words(found, trials))
    return BROKEN if broken else 0


MARKS = {"good": "good", "absent": "absent", "wrong": "WRONG"}


def words(found: Sequence[Finding], trials: Sequence[Trial]) -> str:
    """For people: one line a finding, what mends it below."""
    lines = [f"runningfix {version('runningfix')}"]
    for one in found:
        lines.append(f"{MARKS[one.state]:<8}{one.name:<34}{one.seen}")
        if one.advice:
            lines.append(f"{'':<8}{'':<34}-> {one.advice}")
    for trial in trials:
        mark = MARKS["good" if trial.right else "wrong"]
        lines.append(f"{mark:<8}{'self-test: ' + trial.name:<34}{trial.seen} ({trial.seconds:.1f} s)")
    wrong = [one.name for one in found if one.state == "wrong"] + [one.name for one in trials if not one.right]
    lines.append(f"wrong: {', '.join(wrong)}" if wrong else "nothing is wrong")
    return "\n".join(lines)
