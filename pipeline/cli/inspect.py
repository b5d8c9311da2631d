"""`runningfix inspect`: what is in a flight log, and what it lacks for camera poses."""

from __future__ import annotations

import math
import time
from argparse import Namespace
from dataclasses import asdict
from typing import Any

from calibration.foundation.files import write_whole
from pipeline.cli.console import Console
from pipeline.report import log_picture
from pipeline.stages import log_paths
from pipeline.telemetry import FlightLog, Inspection, inspect_log, position_worth, read_log


def run(arguments: Namespace, console: Console) -> int:
    """Reads the log, tells what it holds, draws it where `-o` asks for a picture."""
    begin = time.perf_counter()
    log = read_log(
        arguments.log,
        system=arguments.system,
        dialect=arguments.dialect,
        progress=lambda share: console.progress("read", round(100 * share), 100),
    )
    found = inspect_log(log)
    files = []
    if arguments.output is not None:
        write_whole(arguments.output, log_picture(found.file, log_paths(log)))
        files.append(str(arguments.output))
    seconds = {"inspect": round(time.perf_counter() - begin, 3)}
    summary = {"status": "done", "command": "inspect", **_plain(found, log), "seconds": seconds, "files": files}
    words = [*found.words, *(f"written {name}" for name in files)]
    if arguments.verbose:
        words += [f"  {name:<40}{many:>9}" for name, many in found.counts.items()]
    console.result(summary, "\n".join(words))
    return 0


def _plain(found: Inspection, log: FlightLog) -> dict[str, Any]:
    """The inspection as JSON has it: no NaN."""
    return {
        "log": found.file,
        "format": found.format,
        "system": log.system,
        "systems": list(log.systems),
        "gimbals": list(log.gimbals),
        "messages": found.messages,
        "counts": dict(found.counts),
        "corrupt_packets": found.corrupt_packets,
        "series": [
            {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in asdict(one).items()}
            for one in found.series
        ],
        "heights": None if log.position is None else {"datum": log.position.datum, "from": log.position.height_from},
        "utc": None if log.utc is None else asdict(log.utc),
        "camera_events": len(log.camera_event_s),
        "missing": list(found.missing),
        "warnings": [*log.notes, *position_worth(log).notes],
        "flight_file": list(found.flight_file),
        "words": list(found.words),
    }
