"""Kills commands at random moments, gives them again, and compares with an undisturbed one byte by byte.

usage: python -m scripts.validation.check_kills [--kills 5] [--seed 0] [--commands run solve track calibrate batch]

A file of the user's lies in each output folder under a name that the command writes beside, and has to stay. What holds
seconds (a batch's catalogue, page and outcomes) is compared without them.

Every command is a process of its own, forked from one that has imported everything: its time is work, and kills hit
work, not the start of Python. So many kills have to hit: where a command was quicker than its moment, another is drawn.
The flight is the first seconds of the example's; what can be killed is the same.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import av
import pandas as pd

import pipeline.batch
import pipeline.cli.calibrate
import pipeline.cli.flights
import pipeline.report  # noqa: F401  # all that a command imports
from pipeline.cli.main import main as cli
from scripts.validation.check_batch import Kind
from scripts.validation.check_resume import contents, example
from scripts.validation.figures import tell

COMMANDS = ("run", "solve", "track", "calibrate", "batch")
MINE = "trajectory-notes.txt"
LEAST_S = 0.01
FRAMES, OFFSET_S = 90, 1.6
"""Of the example that are used, and by which its second camera began later."""
SMALL = Kind(length_s=4.0, targets=1, offsets=True)
"""The flights of a batch."""
Compared = Callable[[Path], object]


def prepare(folder: Path, wanted: list[str]) -> dict[str, Path]:
    """The inputs of every command: a short flight with video, board photos, and flights drawn without video."""
    found = {}
    if set(wanted) - {"batch"}:
        ended(forked(lambda: bool(example(folder)) - 1))  # not here: what has used OpenCV's threads cannot be forked
        found["flight"] = shortened(folder / "flight/flight.toml", folder)
    if "batch" in wanted:
        for number in range(2):
            SMALL.write(70000 + number, folder / "many" / f"drawn-{number}")
        found["many"] = folder / "many"
    return found


def shortened(flight: Path, folder: Path) -> Path:
    """The example's first frames with two of its targets, its offset roughly known, the second camera's tracks from a
    file (a process for one video is quickly there); and five photos of a board."""
    for video in flight.parent.glob("*.mp4"):
        whole = video.rename(video.with_suffix(".whole"))
        with av.open(str(whole)) as source, av.open(str(video), "w") as out:
            picture = source.streams.video[0]
            copy = out.add_stream_from_template(picture)
            for packet in source.demux(picture):
                if packet.pts is not None and packet.pts * picture.time_base < FRAMES / 25:
                    packet.stream = copy
                    out.mux(packet)
        whole.unlink()
    text = flight.read_text()
    begin, end = text.index("[targets.van]"), text.index("[solve]")
    known = f"offset_s = {OFFSET_S}\n[cameras.uav2.sigma]\noffset_s = 0.05"
    flight.write_text((text[:begin] + text[end:]).replace("[cameras.uav2.sigma]", known))
    ended(started(["track", str(flight), "-o", str(folder / "tracked"), "--quiet"]))
    rows = pd.read_csv(folder / "tracked/tracks.csv").query("camera == 'uav2' and x_px == x_px")
    rows[["frame", "target", "x_px", "y_px", "sigma_px"]].to_csv(flight.with_name("uav2.csv"), index=False)
    text = re.sub(r"boxes.uav2 = .*\n", "", flight.read_text())
    flight.write_text(text.replace('video = "uav2.mp4"', 'tracks = "uav2.csv"'))
    for photo in sorted((flight.parent / "board-uav1").iterdir())[5:]:
        photo.unlink()
    return flight


def command(name: str, inputs: dict[str, Path], out: Path) -> list[str]:
    """What is asked of `runningfix`, writing into `out`."""
    if name == "calibrate":
        photos = inputs["flight"].parent / "board-uav1"
        board = ["--board", "9x6", "--square-mm", "25"]
        return [name, str(photos), *board, "-o", str(out / "camera.json"), "--report", "--quiet"]
    if name == "batch":
        return [name, str(inputs["many"] / "*" / "flight.toml"), "-o", str(out), "--jobs", "1", "--quiet"]
    return [name, str(inputs["flight"]), "-o", str(out), "--quiet"]


def started(words: list[str]) -> int:
    """The process of a command that has just begun."""
    return forked(lambda: cli(words))


def forked(action: Callable[[], int]) -> int:
    """A process that does something and ends with its exit code; what it says is not shown."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            os.setsid()
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nowhere, stream)
            code = action()
        finally:
            os._exit(code)
    return process


def ended(process: int, within_s: float = math.inf) -> int | None:
    """Its exit code; None where it has not ended by then."""
    until = time.perf_counter() + within_s
    while time.perf_counter() < until:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.001)
    return None


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
        ended(started(command("track", inputs, prepared)))
        ended(started(command("poses", inputs, prepared)))
    if name == "solve":
        shutil.copytree(prepared, out)
    out.mkdir(exist_ok=True)
    (out / MINE).write_text("mine")


class Killing:
    """One command, killed and given again as often as asked."""

    def __init__(self, name: str, folder: Path, inputs: dict[str, Path], seed: int) -> None:
        self.name, self.folder, self.inputs, self.out = name, folder, inputs, folder / name
        self.moments = random.Random(f"{seed} {name}")
        self.kills = self.hits = self.wrong = 0
        for _ in range(2):  # the second time nothing is loaded or compiled for the first time
            shutil.rmtree(self.out, ignore_errors=True)
            begin(name, folder, inputs, self.out)
            start = time.perf_counter()
            self.code = self._given()
            self.length_s = time.perf_counter() - start
        self.whole = compared(name)(self.out)

    def _given(self, within_s: float = math.inf) -> int | None:
        """The exit code of the command; None where it was killed after so many seconds."""
        process = started(command(self.name, self.inputs, self.out))
        code = ended(process, within_s)
        if code is None:
            os.kill(process, signal.SIGKILL)
            ended(process)
        return code

    def hit(self) -> None:
        """Kills once, drawing moments until one hits, and gives the command again."""
        before = self.hits
        while self.hits == before:
            shutil.rmtree(self.out)
            begin(self.name, self.folder, self.inputs, self.out)
            self.kills += 1
            self.hits += self._given(self.moments.uniform(LEAST_S, self.length_s)) is None
        half = {str(path.relative_to(self.out)) for path in self.out.rglob("*") if path.is_file()}
        again = self._given()
        mine = (self.out / MINE).is_file() and (self.out / MINE).read_text() == "mine"
        if not (mine and again == self.code and compared(self.name)(self.out) == self.whole):
            self.wrong += 1
            print(f"{self.name}, kill {self.kills}: exit {again}, not {self.code}; mine {mine}; {half}", flush=True)

    def row(self) -> dict[str, int]:
        """What came of it."""
        return {"kills": self.kills, "hits": self.hits, "wrong": self.wrong, "exit_code": self.code or 0}


def main() -> int:
    """Prints lines as it goes, a kill of each command in turn; 0 where nothing differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        inputs = prepare(Path(folder), given.commands)
        killing = [Killing(name, Path(folder), inputs, given.seed) for name in given.commands]
        for number in range(given.kills):
            for each in killing:
                each.hit()
            if number % 5 == 4 or number + 1 == given.kills:
                print(*(f"{each.name} {each.row()}" for each in killing), sep="\n", flush=True)
    tell({f"{each.name}_{key}": value for each in killing for key, value in each.row().items()})
    return int(any(each.wrong for each in killing))


if __name__ == "__main__":
    sys.exit(main())
