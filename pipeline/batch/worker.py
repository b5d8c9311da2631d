"""The process that runs flights, one after the other: `python -m pipeline.batch.worker`, started by `kept`.

It is told a flight file and a folder on each line of standard input and answers a line for each; it ends with whoever
started it. Files are local here: what is elsewhere was fetched before.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import sys
import threading
import time
from pathlib import Path
from typing import Any

from calibration.foundation.errors import InputFileError, RunningFixError, WriteError
from pipeline.batch.dataset import trajectory_parquet
from pipeline.flight import read_flight
from pipeline.solver import make_ready
from pipeline.stages import run_flight

LOCK_PATIENCE_S = 10.0
"""How long a folder may be another's: of a worker that was killed just now."""


def serve() -> None:
    """Answers every line until standard input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is no answer
    asked: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    make_ready(lambda done, of: None)
    answers.write("ready\n")
    answers.flush()
    while True:
        answer = fly(json.loads(asked.get()))
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _listen(asked: queue.Queue[str]) -> None:
    """Hands on what is asked; ends this process, also in the middle of a flight, when nobody can ask any more."""
    for line in sys.stdin:
        asked.put(line)
    os._exit(0)


def fly(request: dict[str, Any]) -> dict[str, Any]:
    """Runs one flight: what `FlightOutcome` holds of it, or the error that stopped it."""
    limit_memory(request["hard_bytes"])
    begin = time.perf_counter()
    try:
        found = _flown(Path(request["flight"]), Path(request["out"]))
    except RunningFixError as error:
        found = {"stop": _parts(error)}
    except MemoryError:
        found = {"memory": True}
    except Exception as error:
        found = {"stop": _parts(_fault(error))}
    return {**found, "seconds": time.perf_counter() - begin}


def _flown(flight_file: Path, out: Path) -> dict[str, Any]:
    flight, until = read_flight(flight_file), time.monotonic() + LOCK_PATIENCE_S
    while True:
        try:
            summary = run_flight(flight, out)
            break
        except WriteError as error:
            if "is writing results here" not in error.seen or time.monotonic() > until:
                raise
            time.sleep(0.2)
    solution = json.loads((out / "solution.json").read_text(encoding="utf-8"))
    verdict, clocks, motions = solution["verdict"], solution["clocks"], solution["motions"]
    return {
        "verdict": verdict["grade"],
        "reasons": [reason["words"] for reason in verdict["reasons"]],
        "method": solution["method"],
        "offsets": [{key: clock[key] for key in ("camera", "offset_s", "offset_sigma_s")} for clock in clocks],
        "positions": [{key: motion[key] for key in ("target", "typical_sigma_m")} for motion in motions],
        "chi_square": solution["chi_square"],
        "degrees_of_freedom": solution["degrees_of_freedom"],
        "warnings": list(summary.warnings),
        "solver_seconds": summary.seconds.get("solver", 0.0),
        "files": {name: (out / name).stat().st_size for name in summary.files},
        "table": trajectory_parquet(out / "trajectory.csv").hex(),
    }


def _parts(error: RunningFixError) -> dict[str, Any]:
    return {name: getattr(error, name) for name in ("where", "seen", "expected", "advice", "exit_code")}


def _fault(error: Exception) -> RunningFixError:
    if isinstance(error, OSError):
        return WriteError(
            where=str(error.filename or "a file"), seen=str(error.strerror), expected="a writable folder with space",
            advice="make room, then give the same command again",
        )  # fmt: skip
    found = InputFileError(
        where="runningfix", seen=f"{type(error).__name__}: {error}",
        expected="no such thing: this is a fault of the program", advice="run this flight alone with --verbose",
    )  # fmt: skip
    found.exit_code = 1
    return found


def limit_memory(most_bytes: int) -> None:
    """From now on the operating system refuses this process more, where it can."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        resource.setrlimit(resource.RLIMIT_DATA, (min(most_bytes, sys.maxsize), hard))


if __name__ == "__main__":
    serve()
