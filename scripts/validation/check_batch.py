"""Many drawn flights without video in one batch: a worker killed, one flight that never ends, one that needs too much.

usage: python -m scripts.validation.check_batch [--flights 200] [--jobs 2] [--scheduler] [--seed 60000] [--keep FOLDER]

Each flight is also run alone, in one process that has everything loaded: its files have to be the same, and the batch
may take at most 1.25 times the sum of those seconds divided by the jobs. The flight that never ends is stopped with its
worker (SIGSTOP) while it is flown; the one that needs too much has a table of poses that does not fit into --memory.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.flight import read_flight
from pipeline.stages import run_flight
from scripts.validation.check_resume import contents
from scripts.validation.drawn_flights import draw, write
from scripts.validation.figures import tell

TIMEOUT_S, MEMORY, LENGTH_S = 60.0, "1400M", 6.0
LARGE_ROWS = 4_000_000
ENDLESS, LARGE = "endless", "large"


def draw_all(folder: Path, count: int, seed: int) -> None:
    """So many flights of six seconds; one more that will be stopped, one more that is too large."""
    for number in range(count - 2):
        write(draw(seed + number, cameras=2, targets=2, length_s=LENGTH_S), folder / f"drawn-{number:03d}")
    write(draw(seed + count, cameras=2, targets=2, length_s=LENGTH_S), folder / ENDLESS)
    too_large(write(draw(seed + count + 1, cameras=2, targets=2, length_s=LENGTH_S), folder / LARGE))


def too_large(flight: Path) -> None:
    """Adds so many poses, of frames long after the last, that the table does not fit."""
    for table in flight.parent.glob("*-poses.csv"):
        *_, last = table.read_text().splitlines()
        frame, rest = last.split(",", 1)
        with table.open("a") as file:
            file.writelines(f"{int(frame) + 1 + n},{rest}\n" for n in range(LARGE_ROWS))


def alone(folder: Path, out: Path) -> float:
    """Seconds of all flights, one after the other in this process, everything loaded."""
    names = sorted(path.name for path in folder.glob("drawn-*"))
    run_flight(read_flight(folder / names[0] / "flight.toml"), out / "warm")
    seconds = 0.0
    for name in names:
        begin = time.perf_counter()
        run_flight(read_flight(folder / name / "flight.toml"), out / name)
        seconds += time.perf_counter() - begin
    return seconds


def workers_of(parents: set[int]) -> list[int]:
    """The processes of this machine that fly, below `parents`."""
    found = []
    for entry in filter(str.isdecimal, os.listdir("/proc")):
        with contextlib.suppress(OSError, IndexError, ValueError):
            words = Path("/proc", entry, "cmdline").read_bytes().split(b"\0")
            parent = int(Path("/proc", entry, "stat").read_bytes().rpartition(b")")[2].split()[1])
            if b"pipeline.batch.worker" in words and parent in parents:
                found.append(int(entry))
    return found


def meddle(process: subprocess.Popen[bytes], parents: set[int], out: Path) -> tuple[bool, bool]:
    """Kills a worker once, and stops the one that flies the endless flight; whether both happened."""
    killed = stopped = False
    while process.poll() is None:
        time.sleep(0.01)
        workers = workers_of(parents)
        if not killed and len(list((out / "flights").glob("*/solution.json"))) >= 5 and workers:
            os.kill(workers[0], signal.SIGKILL)
            killed = True
        lock = next((out / "flights").glob(f"{ENDLESS}-*/.runningfix/lock"), None)
        if not stopped and lock is not None:
            with contextlib.suppress(OSError, ValueError, IndexError):
                holder = int(lock.read_text().split()[0])
                if holder in workers:
                    os.kill(holder, signal.SIGSTOP)
                    stopped = True
    return killed, stopped


@contextlib.contextmanager
def cluster(jobs: int, wanted: bool) -> Iterator[tuple[list[str], set[int]]]:
    """Options for a local cluster of so many workers, and the processes below which flights are flown then."""
    if not wanted:
        yield ["--jobs", str(jobs)], set()
        return
    from distributed import LocalCluster

    with LocalCluster(n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None) as made:
        yield ["--scheduler", made.scheduler_address], {worker.pid for worker in made.workers.values()}


def main() -> int:
    """Prints the figures; 0 where all hold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--scheduler", action="store_true", help="on a local Dask cluster of as many workers")
    parser.add_argument("--seed", type=int, default=60000)
    parser.add_argument("--keep", type=Path, help="folder to work in")
    given = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folder = given.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        draw_all(folder / "in", given.flights, given.seed)
        one_by_one_s = alone(folder / "in", folder / "alone")
        quiet_s = undisturbed(folder, given.jobs)
        options, parents = stack.enter_context(cluster(given.jobs, given.scheduler))
        out = folder / "out"
        process = subprocess.Popen([*command(folder, out), *options], stdout=subprocess.PIPE)
        happened = meddle(process, parents or {process.pid}, out)
        assert process.stdout is not None
        said = json.loads(process.stdout.read())
        same = sum(contents(path) == contents(of_batch(out, path.name)) for path in (folder / "alone").glob("drawn-*"))
    ratio = quiet_s / (one_by_one_s / given.jobs)
    figures = {
        "done": said["count"].get("done", 0), "timeout": said["count"].get("timeout", 0),
        "memory": said["count"].get("memory", 0), "same_as_alone": same, "worker_killed": happened[0],
        "endless_stopped": happened[1], "alone_s": one_by_one_s, "batch_s": quiet_s, "ratio": ratio,
    }  # fmt: skip
    tell(figures)
    print(json.dumps(figures, indent=1))
    whole = figures["done"] == same == given.flights - 2 and figures["timeout"] == figures["memory"] == 1
    return int(not (whole and all(happened) and ratio <= 1.25))


def of_batch(out: Path, name: str) -> Path:
    """The results of a flight in the data set."""
    return next((out / "flights").glob(f"{name}-*"), out / "none")


def command(folder: Path, out: Path, pattern: str = "*") -> list[str]:
    """The batch of the drawn flights."""
    limits = ["--timeout", str(TIMEOUT_S), "--memory", MEMORY, "--json", "--quiet"]
    flights = str(folder / "in" / pattern / "flight.toml")
    return [sys.executable, "-m", "pipeline", "batch", flights, "-o", str(out), *limits]


def undisturbed(folder: Path, jobs: int) -> float:
    """Seconds of the batch of the flights that fly, with nobody meddling; its start included."""
    begin = time.perf_counter()
    subprocess.run(
        [*command(folder, folder / "quiet", "drawn-*"), "--jobs", str(jobs)], stdout=subprocess.DEVNULL, check=False
    )
    seconds = time.perf_counter() - begin
    shutil.rmtree(folder / "quiet")
    return seconds


if __name__ == "__main__":
    sys.exit(main())
