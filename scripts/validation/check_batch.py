"""Many drawn flights without video in one batch: a worker killed, one flight that never ends, one that needs too much.

usage: python -m scripts.validation.check_batch [--flights 200] [--jobs 2] [--scheduler] [--seed 60000] [--length 6]
                                                [--targets 2] [--offsets] [--shared] [--keep FOLDER]

Each flight is also run alone, in one process that has everything loaded: its files have to be the same, and the batch
may take at most 1.25 times the sum of those seconds divided by the jobs. A drawn flight that is refused alone (so short
a track may not determine its offset) makes room for the next. The flight that never ends is stopped with its worker
(SIGSTOP) while it is flown; the one that needs too much has a table of poses that does not fit into --memory.

On a machine that others use (--shared) seconds say nothing. There processor time is held against that of the flights
alone: of the workers, their start included, divided by the jobs, and, as if it never ran beside them, of the command.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from calibration.foundation.errors import RunningFixError
from pipeline.flight import read_flight
from pipeline.stages import run_flight
from scripts.validation.check_resume import contents
from scripts.validation.drawn_flights import draw, write
from scripts.validation.figures import tell

TIMEOUT_S, MEMORY = 60.0, "1400M"
LARGE_ROWS = 4_000_000
ENDLESS, LARGE = "endless", "large"
MOST = 1.25
"""Times the sum of the flights' own seconds, divided by the jobs."""


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What flights are drawn: so many seconds of so many targets, their offsets roughly known or not."""

    length_s: float
    targets: int
    offsets: bool

    def write(self, seed: int, folder: Path) -> Path:
        """Draws one."""
        flight = draw(seed, cameras=2, targets=self.targets, length_s=self.length_s)
        if self.offsets:
            for camera in flight.cameras[1:]:
                camera.told["offset_s"] = round(camera.begin_s, 1)
                camera.told_sigma["offset_s"] = 0.1
        return write(flight, folder)


@dataclass(frozen=True, kw_only=True)
class Took:
    """Wall and processor seconds; `own_s` is the part of the command's own process."""

    wall_s: float
    processor_s: float
    own_s: float = 0.0


def too_large(flight: Path) -> None:
    """Adds so many poses, of frames long after the last, that the table does not fit."""
    for table in flight.parent.glob("*-poses.csv"):
        *_, last = table.read_text().splitlines()
        frame, rest = last.split(",", 1)
        with table.open("a") as file:
            file.writelines(f"{int(frame) + 1 + n},{rest}\n" for n in range(LARGE_ROWS))


def alone(folder: Path, out: Path, kind: Kind, count: int, seed: int) -> Took:
    """Draws so many flights that fly, each flown one after the other in this process, everything loaded."""
    run_flight(read_flight(kind.write(seed - 1, folder / "warm")), out / "warm")
    shutil.rmtree(folder / "warm")
    wall_s = processor_s = 0.0
    numbers = itertools.count()
    done = 0
    while done < count:
        number = next(numbers)
        name = f"drawn-{number:03d}"
        file = kind.write(seed + number, folder / name)
        begin, ran = time.perf_counter(), time.process_time()
        try:
            run_flight(read_flight(file), out / name)
        except RunningFixError:
            shutil.rmtree(folder / name)
            continue
        wall_s, processor_s = wall_s + time.perf_counter() - begin, processor_s + time.process_time() - ran
        done += 1
    return Took(wall_s=wall_s, processor_s=processor_s)


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
    parser.add_argument("--length", type=float, default=6.0, help="seconds of a flight")
    parser.add_argument("--targets", type=int, default=2)
    parser.add_argument("--offsets", action="store_true", help="offsets are roughly known: small flights")
    parser.add_argument("--shared", action="store_true", help="judged by processor time")
    parser.add_argument("--keep", type=Path, help="folder to work in")
    given = parser.parse_args()
    kind = Kind(length_s=given.length, targets=given.targets, offsets=given.offsets)
    with contextlib.ExitStack() as stack:
        folder = given.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        one_by_one = alone(folder / "in", folder / "alone", kind, given.flights - 2, given.seed)
        kind.write(given.seed + 10_000, folder / "in" / ENDLESS)
        too_large(kind.write(given.seed + 10_001, folder / "in" / LARGE))
        quiet = undisturbed(folder, given.jobs)
        options, parents = stack.enter_context(cluster(given.jobs, given.scheduler))
        out = folder / "out"
        process = subprocess.Popen([*command(folder, out), *options], stdout=subprocess.PIPE)
        happened = meddle(process, parents or {process.pid}, out)
        assert process.stdout is not None
        said = json.loads(process.stdout.read())
        same = sum(contents(path) == contents(of_batch(out, path.name)) for path in (folder / "alone").glob("drawn-*"))
    ratio = quiet.wall_s / (one_by_one.wall_s / given.jobs)
    workers_s = quiet.processor_s - quiet.own_s
    ratio_processor = (quiet.own_s + workers_s / given.jobs) / (one_by_one.processor_s / given.jobs)
    figures = {
        "done": said["count"].get("done", 0), "timeout": said["count"].get("timeout", 0),
        "memory": said["count"].get("memory", 0), "same_as_alone": same, "worker_killed": happened[0],
        "endless_stopped": happened[1], "alone_s": one_by_one.wall_s, "batch_s": quiet.wall_s, "ratio": ratio,
        "alone_processor_s": one_by_one.processor_s, "workers_processor_s": workers_s,
        "command_processor_s": quiet.own_s, "ratio_processor": ratio_processor,
    }  # fmt: skip
    tell(figures)
    print(json.dumps(figures, indent=1))
    whole = figures["done"] == same == given.flights - 2 and figures["timeout"] == figures["memory"] == 1
    return int(not (whole and all(happened) and (ratio_processor if given.shared else ratio) <= MOST))


def of_batch(out: Path, name: str) -> Path:
    """The results of a flight in the data set."""
    return next((out / "flights").glob(f"{name}-*"), out / "none")


def command(folder: Path, out: Path, pattern: str = "*") -> list[str]:
    """The batch of the drawn flights."""
    limits = ["--timeout", str(TIMEOUT_S), "--memory", MEMORY, "--json", "--quiet"]
    flights = str(folder / "in" / pattern / "flight.toml")
    return [sys.executable, "-m", "pipeline", "batch", flights, "-o", str(out), *limits]


def undisturbed(folder: Path, jobs: int) -> Took:
    """The batch of the flights that fly, with nobody meddling; its start included."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        [*command(folder, folder / "quiet", "drawn-*"), "--jobs", str(jobs)], stdout=subprocess.DEVNULL
    )
    own_s = 0.0
    while process.poll() is None:
        own_s = max(own_s, processor_s(process.pid))
        time.sleep(0.1)
    wall_s, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    shutil.rmtree(folder / "quiet")
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Took(wall_s=wall_s, processor_s=used, own_s=own_s)


def processor_s(process: int) -> float:
    """What a process itself, without its children, has used so far; 0 where it is gone."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        fields = Path("/proc", str(process), "stat").read_bytes().rpartition(b")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


if __name__ == "__main__":
    sys.exit(main())
