"""Every validation and benchmark behind one command, run from the project's folder.

    python -m scripts.validation                                  lists them, with minutes and what they say
    python -m scripts.validation run tracking logs                runs these two
    python -m scripts.validation run all -o docs/figures.json     runs all; the file keeps the figures of those not run
    python -m scripts.validation page                             docs/figures.json -> docs/accuracy.md

The result file is JSON: for each check its command, the day, version, cores, seconds, exit code and figures. A check
also runs alone, with options of its own: `python -m scripts.validation.check_tracking --help`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from datetime import date
from importlib.metadata import version
from pathlib import Path

from calibration.foundation.files import write_whole
from scripts.validation.checks import CHECKS, Check, named
from scripts.validation.figures import FILE
from scripts.validation.page import accuracy_page, read_results

ROOT = Path(__file__).resolve().parents[2]
RESULTS, PAGE = Path("docs/figures.json"), Path("docs/accuracy.md")


def listing() -> str:
    """A line for each check."""
    lines = [f"{'check':<20}{'minutes':>8}   what it says"]
    for check in CHECKS:
        needs = f" (needs {check.needs})" if check.needs else ""
        lines.append(f"{check.name:<20}{check.minutes:>8g}   {check.says}{needs}")
    return "\n".join([*lines, f"{'all':<20}{sum(c.minutes for c in CHECKS):>8g}"])


def run_one(check: Check, more: tuple[str, ...] = ()) -> dict[str, object]:
    """Runs a check in a process of its own, what it prints going on to ours, and returns its record."""
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "figures.json"
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, *check.program, *more], cwd=ROOT, env={**os.environ, FILE: str(told)}, check=False
        )
        seconds = time.perf_counter() - began
        figures = json.loads(told.read_text()) if told.exists() else {}
    return {
        "command": " ".join(["python", *check.program]),
        "day": date.today().isoformat(),
        "version": version("runningfix"),
        "cores": os.cpu_count(),
        "seconds": round(seconds, 1),
        "exit_code": done.returncode,
        "figures": figures,
    }


def run(names: list[str], results: Path, real: Path | None) -> int:
    """Runs checks one after another and writes the result file anew after each; 1 where one of them failed."""
    failed = []
    for check in named(names):
        if check.needs and real is None:
            print(f"{check.name} needs {check.needs}", file=sys.stderr)
            failed.append(check.name)
            continue
        print(f"\n== {check.name}, about {check.minutes:g} minutes", flush=True)
        record = run_one(check, (str(real.resolve()),) if check.needs and real else ())
        known = json.loads(results.read_text()) if results.exists() else {}
        text = json.dumps({**known, check.name: record}, indent=1, sort_keys=True) + "\n"
        write_whole(results, text)
        if record["exit_code"]:
            failed.append(check.name)
    print(f"\nfailed: {', '.join(failed)}" if failed else "\nevery check that was run is fine")
    return 1 if failed else 0


def main() -> int:
    """Lists, runs, or writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m scripts.validation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    doing = parser.add_subparsers(dest="doing")
    doing.add_parser("list", help="lists the checks (the default)")
    asked = doing.add_parser("run", help="runs checks")
    asked.add_argument("names", nargs="+", metavar="NAME", help="of the list; all: every one that needs nothing")
    asked.add_argument("-o", "--output", type=Path, default=RESULTS, help=f"result file (default {RESULTS})")
    asked.add_argument("--real", type=Path, help="folder or file that the checks named need")
    doing.add_parser("page", help=f"{RESULTS} -> {PAGE}")
    given = parser.parse_args()
    if given.doing == "page":
        write_whole(PAGE, accuracy_page(read_results(RESULTS)))
        return 0
    if given.doing != "run":
        print(listing())
        return 0
    try:
        return run(given.names, given.output, given.real)
    except KeyError as unknown:
        parser.error(f"{unknown.args[0]}: no such check; the list: {', '.join(c.name for c in CHECKS)}")


if __name__ == "__main__":
    sys.exit(main())
