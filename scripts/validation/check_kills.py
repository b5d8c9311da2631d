"""Kills commands at random moments, gives them again, and compares with an undisturbed one byte by byte.

usage: python -m scripts.validation.check_kills [--kills 5] [--seed 0] [--commands run solve track calibrate batch]

A file of the user's lies in each output folder under a name that the command writes beside, and has to stay. What holds
seconds (a batch's catalogue, page and outcomes) is compared without them.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from scripts.validation.check_resume import contents, example
from scripts.validation.drawn_flights import draw, write
from scripts.validation.figures import tell

COMMANDS = ("run", "solve", "track", "calibrate", "batch")
MINE = "trajectory-notes.txt"
LEAST_S = 0.05
Compared = Callable[[Path], object]


def prepare(folder: Path, wanted: list[str]) -> dict[str, Path]:
    """The inputs of every command: the example flight, and small ones drawn without video for a batch."""
    found = {"flight": example(folder)} if set(wanted) - {"batch"} else {}
    if "batch" in wanted:
        for number in range(4):
            write(draw(70000 + number, cameras=2, targets=2, length_s=6.0), folder / "many" / f"drawn-{number}")
        found["many"] = folder / "many"
    return found


def command(name: str, inputs: dict[str, Path], out: Path) -> list[str]:
    """The command that is killed, writing into `out`."""
    start = [sys.executable, "-m", "pipeline", name]
    if name == "calibrate":
        photos = inputs["flight"].parent / "board-uav1"
        board = ["--board", "9x6", "--square-mm", "25"]
        return [*start, str(photos), *board, "-o", str(out / "camera.json"), "--report", "--quiet"]
    if name == "batch":
        return [*start, str(inputs["many"] / "*" / "flight.toml"), "-o", str(out), "--jobs", "2", "--quiet"]
    return [*start, str(inputs["flight"]), "-o", str(out), "--quiet"]


def compared(name: str) -> Compared:
    """What of an output folder has to be the same."""
    return without_seconds if name == "batch" else contents


def without_seconds(out: Path) -> object:
    """A batch's files but those with seconds, and its catalogue without them."""
    timed = ("catalogue.parquet", "index.html", ".runningfix/ledger.json")
    files = {n: c for n, c in contents(out).items() if n not in timed and ".runningfix/outcomes/" not in n}
    table = pd.read_parquet(out / "catalogue.parquet").drop(columns=["seconds", "solver_seconds"])
    return files, table.astype(str).to_dict()


def begin(name: str, folder: Path, inputs: dict[str, Path], out: Path) -> None:
    """An output folder as the command finds it: with a file of the user's, and, for `solve`, tracks and poses."""
    prepared = folder / "prepared"
    if name == "solve" and not prepared.exists():
        subprocess.run(command("track", inputs, prepared), check=True)
        subprocess.run(command("poses", inputs, prepared), check=True)
    if name == "solve":
        shutil.copytree(prepared, out)
    out.mkdir(exist_ok=True)
    (out / MINE).write_text("mine")


def killed(name: str, folder: Path, inputs: dict[str, Path], kills: int, moments: random.Random) -> dict[str, int]:
    """How many kills hit a running process, and after how many the second run did not lead to the same."""
    out = folder / name
    begin(name, folder, inputs, out)
    start = time.perf_counter()
    codes = [subprocess.run(command(name, inputs, out), check=False).returncode]
    length_s = time.perf_counter() - start
    whole, hits, wrong = compared(name)(out), 0, 0
    for _ in range(kills):
        shutil.rmtree(out)
        begin(name, folder, inputs, out)
        process = subprocess.Popen(command(name, inputs, out), start_new_session=True)
        try:
            process.wait(timeout=moments.uniform(LEAST_S, length_s))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            hits += 1
        codes.append(subprocess.run(command(name, inputs, out), check=False).returncode)
        mine = (out / MINE).is_file() and (out / MINE).read_text() == "mine"
        wrong += not (mine and codes[-1] == codes[0] and compared(name)(out) == whole)
    return {"kills": kills, "hits": hits, "wrong": wrong}


def main() -> int:
    """Prints a line for each command; 0 where nothing differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    given = parser.parse_args()
    found: dict[str, dict[str, int]] = {}
    with tempfile.TemporaryDirectory() as folder:
        inputs = prepare(Path(folder), given.commands)
        for name in given.commands:
            found[name] = killed(name, Path(folder), inputs, given.kills, random.Random(given.seed))
            print(f"{name:<10} {found[name]}", flush=True)
    tell({f"{name}_{key}": value for name, row in found.items() for key, value in row.items()})
    return int(any(row["wrong"] for row in found.values()))


if __name__ == "__main__":
    sys.exit(main())
