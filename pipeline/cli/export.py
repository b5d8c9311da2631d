"""`runningfix export`: a finished run as a recording of the Rerun viewer."""

from __future__ import annotations

import time
from argparse import Namespace

from pipeline.cli.console import Console
from pipeline.flight import read_flight
from pipeline.stages import record_flight


def run(arguments: Namespace, console: Console) -> int:
    """Writes the recording and says what is not in it."""
    begin = time.perf_counter()
    flight = read_flight(arguments.flight)
    to = arguments.to or arguments.output / f"{flight.path.stem}.rrd"
    made = record_flight(flight, arguments.output, to, videos=not arguments.no_video, progress=console.progress)
    for warning in made.warnings:
        console.say(f"note: {warning}")
    seconds = {"export": round(time.perf_counter() - begin, 3)}
    summary = {
        "status": "done", "command": "export", "files": [str(made.file)], "warnings": list(made.warnings),
        "seconds": seconds,
    }  # fmt: skip
    console.result(summary, f"wrote     {made.file}\nlook      rerun {made.file}")
    return 0
