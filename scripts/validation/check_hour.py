"""An hour of two videos with twenty targets through `runningfix run`: memory over time, and seconds.

usage: python -m scripts.validation.check_hour [--minutes 60] [--rate 1] [--keep FOLDER]

The pictures are 480 x 270 at 1 Hz (--rate; at 25 Hz tracking takes 25 times as long), a minute of them rendered and
repeated (extra `demo`); the targets cross them one after the other (`drawn_hours`). The logs are an hour long.
Memory is what the command and its processes have resident together, looked at twice a second; what they share counts
for each. It has to stay under 2 GB throughout, and while the videos are tracked, the greatest of the second half may be
at most 1.1 times the greatest of the first half, its first tenth (warming up) left out. Results have to be right, too.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.batch.kept import session_bytes
from scripts.validation.drawn_hours import LOOP_S, TARGETS, crossings, place, write_hours
from scripts.validation.figures import tell

LOOK_EVERY_S, WARM = 0.5, 0.1
MOST_MB, MOST_GROWTH = 2000.0, 1.1
MOST_CLAIMS = 2.0
"""Error over claimed sigma, root mean square over all targets and times."""
Look = tuple[float, str, float]
"""Seconds since the start, what is being done, MB."""


def flown(flight: Path, out: Path) -> tuple[int, dict[str, object], list[Look]]:
    """Runs the command: its exit code, what it says as JSON, and its memory over time."""
    command = [sys.executable, "-m", "pipeline", "run", str(flight), "-o", str(out), "--json"]
    begin = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    doing, said = ["start"], [""]

    def listen() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            print(line, end="", file=sys.stderr, flush=True)
            if not line.startswith(("note", "runningfix")):
                doing[0] = "track" if line.startswith("track ") else line.split(":")[0].strip()

    def hear() -> None:
        assert process.stdout is not None
        said[0] = process.stdout.read()

    threads = [threading.Thread(target=each, daemon=True) for each in (listen, hear)]
    for thread in threads:
        thread.start()
    looks: list[Look] = []
    try:
        while process.poll() is None:
            looks.append((time.perf_counter() - begin, doing[0], session_bytes(process.pid) / 1e6))
            time.sleep(LOOK_EVERY_S)
    finally:
        if process.poll() is None:  # of a session of its own: an interrupt does not reach it
            process.terminate()
    for thread in threads:
        thread.join()
    return process.returncode, json.loads(said[0] or "{}"), looks


def growth(looks: list[Look]) -> float:
    """The greatest memory of tracking's second half over that of its first, without the warming up."""
    used = np.array([mb for _, stage, mb in looks if stage == "track"])
    warm, half = round(WARM * len(used)), len(used) // 2
    return float(used[half:].max() / used[warm:half].max()) if half > warm else float("nan")


def claims(out: Path, seconds: float) -> tuple[float, float]:
    """Root mean square of errors over claimed sigmas, and of errors in metres."""
    table = pd.read_csv(out / "trajectory.csv")
    error, sigma = [], []
    for name, (lane, loop) in crossings(seconds).items():
        rows = table[table.target == name]
        true = place(lane, rows.time_s.to_numpy() - loop * LOOP_S)
        error.append(np.sum((rows[["east_m", "north_m", "up_m"]].to_numpy() - true) ** 2, axis=1))
        sigma.append((rows.cov_ee + rows.cov_nn + rows.cov_uu).to_numpy())
    errors, sigmas = np.concatenate(error), np.concatenate(sigma)
    return float(np.sqrt(np.mean(errors / sigmas))), float(np.sqrt(np.mean(errors)))


def main() -> int:
    """Prints the figures; 0 where memory is bounded and the results are right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--rate", type=float, default=1.0, help="frames a second")
    parser.add_argument("--keep", type=Path, help="folder to work in; a flight that is there is flown again")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the command does not go on alone
    with contextlib.ExitStack() as stack:
        folder = given.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        flight, out = folder / "flight.toml", folder / "out"
        if not flight.exists():
            write_hours(folder, 60.0 * given.minutes, given.rate)
        code, said, looks = flown(flight, out)
        tracks = pd.read_csv(out / "tracks.csv", usecols=["x_px"])
        over, error_m = (
            claims(out, 60.0 * given.minutes) if (out / "trajectory.csv").exists() else (float("nan"), float("nan"))
        )
    greatest = {
        stage: max(mb for _, name, mb in looks if name == stage) for stage in dict.fromkeys(s for _, s, _ in looks)
    }
    figures = {
        "minutes": given.minutes, "rate_hz": given.rate, "targets": TARGETS, "exit_code": code, "seconds": looks[-1][0],
        "stage_seconds": said.get("seconds", {}), "greatest_mb": max(mb for *_, mb in looks),
        "stage_mb": greatest, "growth": growth(looks), "share_with_fix": float(tracks.x_px.notna().mean()),
        "error_over_claim": over, "error_m": error_m,
    }  # fmt: skip
    tell(figures)
    print(json.dumps(figures, indent=1))
    bounded = float(figures["greatest_mb"]) <= MOST_MB and float(figures["growth"]) <= MOST_GROWTH
    return int(not (code == 0 and bounded and over <= MOST_CLAIMS))


if __name__ == "__main__":
    sys.exit(main())
