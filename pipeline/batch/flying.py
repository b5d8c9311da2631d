"""One flight of a batch: fetched where it is elsewhere, run by a kept worker, its results brought to where they belong.

This runs beside the worker, in the process that spreads the flights or in that of a cluster.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from calibration.foundation.errors import InputFileError, RunningFixError, UsageError
from pipeline.batch.kept import Ended, KeptWorker
from pipeline.batch.limits import Limits
from pipeline.batch.outcome import FlightOutcome, stopped
from pipeline.batch.places import as_path, file_system, inside, is_url, reaching
from pipeline.batch.which import NamedFlight
from pipeline.flight import Flight, read_flight
from pipeline.stages import decisive

RESULTS = "flights"
"""Folder of the data set with a folder of results for each flight, as `runningfix run` leaves them."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One flight to be done: which, where its results go (a folder or URL of the whole batch), within what.

    known  its key and outcome of before, where there is one: the same key, and nothing is done
    """

    flight: NamedFlight
    out: str
    limits: Limits
    known: FlightOutcome | None = None


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of a task: the outcome, its trajectories as GeoParquet (empty: none, or done before)."""

    outcome: FlightOutcome
    table: bytes = b""
    found_finished: bool = False


def fly(task: Task, worker: KeptWorker) -> Flown:
    """Does a task; whatever is wrong with its flight is its outcome, never an exception."""
    flight = task.flight
    try:
        with _at_hand(flight.source) as here:
            return _by_its_place(_fly(task, here, worker), here)
    except RunningFixError as error:
        return Flown(outcome=stopped(flight.name, flight.source, error))
    except Exception as error:  # a fault of the program in one flight stops no other
        fault = InputFileError(
            where="runningfix", seen=f"{type(error).__name__}: {error}",
            expected="no such thing: this is a fault of the program", advice="run this flight alone with --verbose",
        )  # fmt: skip
        return Flown(outcome=replace(stopped(flight.name, flight.source, fault), exit_code=1))


def _fly(task: Task, here: Path, worker: KeptWorker) -> Flown:
    """Does a task whose files are at hand."""
    flight, known = task.flight, task.known
    try:
        key = key_of(flight.source, here)
    except RunningFixError as error:
        return Flown(outcome=stopped(flight.name, flight.source, error))
    if known is not None and known.key == _judged(key, known.status, task.limits) and _complete(task, known):
        return Flown(outcome=known, found_finished=True)
    return _flown(task, here, key, worker)


def _by_its_place(flown: Flown, here: Path) -> Flown:
    """What is said of a flight that was fetched, with where it was fetched from instead of where to."""
    outcome = flown.outcome
    if not is_url(outcome.source) or as_path(outcome.source) is not None:
        return flown
    fetched = str(here).removesuffix(inside(outcome.source))
    place = outcome.source.removesuffix(inside(outcome.source))
    error = {part: text.replace(fetched, place) for part, text in outcome.error.items()}
    warnings = tuple(text.replace(fetched, place) for text in outcome.warnings)
    return replace(flown, outcome=replace(outcome, error=error, warnings=warnings))


def _flown(task: Task, here: Path, key: str, worker: KeptWorker) -> Flown:
    flight, out = task.flight, as_path(task.out)
    with contextlib.ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="runningfix-"))) / flight.name
        else:
            folder = out / RESULTS / flight.name
        answer = worker.fly(here, folder, task.limits)
        outcome = outcome_from(flight, key, answer, task.limits)
        if outcome.status == "done" and out is None:
            _bring(folder, outcome.files, f"{task.out.rstrip('/')}/{RESULTS}/{flight.name}")
    table = bytes.fromhex(answer["table"]) if isinstance(answer, Mapping) and "table" in answer else b""
    return Flown(outcome=outcome, table=table)


def outcome_from(flight: NamedFlight, key: str, answer: Mapping[str, Any] | Ended, limits: Limits) -> FlightOutcome:
    """A worker's answer, or the lack of one, as an outcome."""
    if isinstance(answer, Ended):
        error = _why(flight, answer, limits)
        return replace(
            stopped(flight.name, flight.source, error, status=answer.why, seconds=answer.seconds),
            key=_judged(key, answer.why, limits), versions=decisive(),
        )  # fmt: skip
    if "stop" in answer:
        code = answer["stop"]["exit_code"]
        error = InputFileError(**{name: text for name, text in answer["stop"].items() if name != "exit_code"})
        found = stopped(flight.name, flight.source, error, seconds=answer["seconds"])
        return replace(found, key=key, exit_code=code, versions=decisive())
    lists = ("reasons", "offsets", "positions", "warnings")
    told: dict[str, Any] = {
        name: tuple(value) if name in lists else value for name, value in answer.items() if name != "table"
    }
    return FlightOutcome(
        name=flight.name, source=flight.source, status="done", key=key, versions=decisive(), **told,
        exit_code=7 if told["verdict"] == "bad" else 0,
    )  # fmt: skip


def _why(flight: NamedFlight, ended: Ended, limits: Limits) -> RunningFixError:
    if ended.why == "timeout":
        seen, expected = "not finished", f"an end within {limits.time_s:g} s (--timeout)"
        advice = "give it more time, or run it alone to see where it stays"
    elif ended.why == "memory":
        seen = f"{max(ended.memory_bytes, limits.memory_bytes) / 1e6:,.0f} MB of memory"
        expected = f"at most {limits.memory_bytes / 1e6:,.0f} MB (--memory)"
        advice = "give it more, with fewer --jobs, or run it alone"
    else:
        seen = f"its process ended by itself, twice{f' (signal {ended.signal})' if ended.signal else ''}"
        expected, advice = "results or an error in words", "run it alone with --verbose, and report it"
    error = UsageError(where=flight.source, seen=seen, expected=expected, advice=advice)
    error.exit_code = 1
    return error


def _judged(key: str, status: str, limits: Limits) -> str:
    """The key of an outcome: that a limit was broken is no news of another limit."""
    broken = {"timeout": f" {limits.time_s:g} s", "memory": f" {limits.memory_bytes} bytes"}
    return key + broken.get(status, "")


def key_of(source: str, here: Path) -> str:
    """A hash of all that decides a flight's outcome: its file, size and time of those it names, versions."""
    flight = read_flight(here)
    parts: list[object] = [source, hashlib.sha256(here.read_bytes()).hexdigest(), sorted(decisive().items())]
    for path in named_files(flight):
        with contextlib.suppress(OSError):
            status = path.stat()
            parts.append([path.name, status.st_size, 0 if is_url(source) else status.st_mtime_ns])
            if is_url(source):
                parts.append(hashlib.sha256(path.read_bytes()).hexdigest())
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def named_files(value: object) -> list[Path]:
    """Every path in a flight's settings, however deep."""
    if isinstance(value, Path):
        return [value]
    if is_dataclass(value):
        inner = [getattr(value, field.name) for field in fields(value) if field.name != "path"]
        return [path for each in inner for path in named_files(each)]
    if isinstance(value, Mapping):
        return [path for each in value.values() for path in named_files(each)]
    return [path for each in value for path in named_files(each)] if isinstance(value, list | tuple) else []


def _complete(task: Task, known: FlightOutcome) -> bool:
    """Whether every file of a finished flight is still there, as long as it was."""
    out = as_path(task.out)
    if out is not None:
        sizes = {name: out / RESULTS / known.name / name for name in known.files}
        return all(path.is_file() and path.stat().st_size == known.files[name] for name, path in sizes.items())
    folder = f"{task.out.rstrip('/')}/{RESULTS}/{known.name}"
    system = file_system(folder)
    with reaching(folder):
        return all(
            system.exists(f"{folder}/{name}") and system.size(f"{folder}/{name}") == size
            for name, size in known.files.items()
        )


@contextlib.contextmanager
def _at_hand(source: str) -> Iterator[Path]:
    """The flight file on this machine, with the files that it names; gone again afterwards if they were fetched."""
    here = as_path(source)
    if here is not None:
        yield here
        return
    with tempfile.TemporaryDirectory(prefix="runningfix-") as name:
        top = Path(os.path.realpath(name))
        file = _fetched(source, top)
        for path in named_files(_read(file)):
            _fetch_named(source, top, path)
        yield file


def _read(file: Path) -> Flight:
    return read_flight(file)


def _fetch_named(source: str, top: Path, path: Path) -> None:
    """Fetches a file that a flight names beside its flight file. Raises UsageError where it leads out of that place."""
    place = Path(os.path.normpath(path))
    scheme = source.partition("://")[0]
    if not place.is_relative_to(top):
        raise UsageError(
            where=source, seen=f"{path.name}, which lies in no place below {scheme}://",
            expected="files beside the flight file", advice="name it relative to the flight file",
        )  # fmt: skip
    if not place.exists():
        with contextlib.suppress(InputFileError):  # that it is missing is said when the flight is read, by its key
            _fetched(f"{scheme}://{place.relative_to(top).as_posix()}", top)


def _fetched(url: str, top: Path) -> Path:
    place = top / inside(url)
    place.parent.mkdir(parents=True, exist_ok=True)
    system, part = file_system(url), place.with_name(f".{place.name[:100]}.part")
    with reaching(url), system.open(url, "rb") as source, part.open("wb") as target:
        shutil.copyfileobj(source, target, 1 << 20)
    os.replace(part, place)
    return place


def _bring(folder: Path, files: Mapping[str, int], url: str) -> None:
    """Results to where they belong; solution.json last, as it says that the others are there."""
    system = file_system(url)
    for name in sorted(files, key=lambda name: name == "solution.json"):
        put(system, f"{url}/{name}", (folder / name).read_bytes())


def put(system: Any, url: str, content: bytes) -> None:
    """Writes a file elsewhere. Raises WriteError."""
    with reaching(url, to_write=True):
        with contextlib.suppress(NotImplementedError, FileExistsError):
            system.makedirs(url.rpartition("/")[0], exist_ok=True)
        system.pipe_file(url, content)


_of_this_process = threading.local()


def fly_here(task: Task) -> Flown:
    """`fly` with a worker of this thread's own, kept for the next: how a cluster's processes do tasks."""
    if not hasattr(_of_this_process, "worker"):
        _of_this_process.worker = KeptWorker()
    return fly(task, _of_this_process.worker)
