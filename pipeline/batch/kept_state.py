"""What is kept of a batch between runs, and its data set: in a folder of this machine, or elsewhere by URL.

Of a folder the ledger of `stages` says what is ours, so that nothing of the user's is written over, and swaps files in
together. Elsewhere files are written one by one, a flight's outcome after its results.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

from calibration.foundation.errors import RunningFixError
from pipeline.batch.flying import put
from pipeline.batch.outcome import FlightOutcome, outcome_of
from pipeline.batch.places import as_path, file_system, reaching
from pipeline.stages import Ledger, writing

OUTCOMES = ".runningfix/outcomes"


class State(Protocol):
    """Where a batch lives."""

    def known(self) -> dict[str, FlightOutcome]:
        """What became of flights before, by name; of those of which all that was written stands."""

    def keep(self, outcome: FlightOutcome, table: bytes) -> tuple[str, ...]:
        """Keeps an outcome with its trajectories. Returns what had to be kept aside, a sentence each."""

    def publish(self, files: Mapping[str, bytes | str]) -> tuple[str, ...]:
        """Writes catalogue and page. Returns what had to be kept aside, a sentence each."""


def trajectory_file(name: str) -> str:
    """Where a flight's trajectories are in the data set."""
    return f"trajectory/flight={name}/trajectory.parquet"


@contextlib.contextmanager
def opened(out: str) -> Iterator[State]:
    """The state of a batch, for one process at a time where that can be held. Raises RunningFixError."""
    here = as_path(out)
    if here is None:
        yield _Elsewhere(out.rstrip("/"))
        return
    with writing(here) as ledger:
        yield _Here(ledger)


class _Here:
    """A folder of this machine."""

    def __init__(self, ledger: Ledger) -> None:
        self.ledger = ledger

    def known(self) -> dict[str, FlightOutcome]:
        """Every flight's outcome, where all that was written with it stands."""
        names = [stage.partition(" ")[2] for stage in self.ledger.stages if stage.startswith("flight ")]
        found = {name: self._known(name) for name in names}
        return {name: outcome for name, outcome in found.items() if outcome is not None}

    def _known(self, name: str) -> FlightOutcome | None:
        file, stage = f"{OUTCOMES}/{name}.json", f"flight {name}"
        if not self.ledger.finished(stage, name) or file not in self.ledger.files(stage):
            return None
        return _read((self.ledger.out / file).read_bytes(), name)

    def keep(self, outcome: FlightOutcome, table: bytes) -> tuple[str, ...]:
        """Swaps in outcome and trajectories together; those of a flight that now fails go."""
        files: dict[str, bytes | str | Path] = {f"{OUTCOMES}/{outcome.name}.json": _text(outcome)}
        if table:
            files[trajectory_file(outcome.name)] = table
        return self.ledger.record(f"flight {outcome.name}", outcome.name, files)

    def publish(self, files: Mapping[str, bytes | str]) -> tuple[str, ...]:
        """Swaps in catalogue and page together."""
        return self.ledger.record("batch", "batch", dict(files))


class _Elsewhere:
    """A place by URL."""

    def __init__(self, url: str) -> None:
        self.url, self.system = url, file_system(url)

    def known(self) -> dict[str, FlightOutcome]:
        """Every flight's outcome; of those that are done, where the trajectories are there."""
        with reaching(self.url):
            self.system.invalidate_cache()
            tables = {str(path).rpartition("/flight=")[2] for path in self.system.glob(f"{self.url}/trajectory/*")}
            found = {}
            for path in self.system.glob(f"{self.url}/{OUTCOMES}/*.json"):
                name = PurePosixPath(str(path)).stem
                outcome = _read(self.system.cat_file(path), name)
                if outcome is not None and (outcome.status != "done" or name in tables):
                    found[name] = outcome
        return found

    def keep(self, outcome: FlightOutcome, table: bytes) -> tuple[str, ...]:
        """Trajectories first, then the outcome that says they are there."""
        path = f"{self.url}/{trajectory_file(outcome.name)}"
        if table:
            put(self.system, path, table)
        else:
            with contextlib.suppress(RunningFixError), reaching(path, to_write=True):
                self.system.rm_file(path)
        put(self.system, f"{self.url}/{OUTCOMES}/{outcome.name}.json", _text(outcome).encode())
        return ()

    def publish(self, files: Mapping[str, bytes | str]) -> tuple[str, ...]:
        """One after the other."""
        for name, content in files.items():
            put(self.system, f"{self.url}/{name}", content if isinstance(content, bytes) else content.encode())
        return ()


def _text(outcome: FlightOutcome) -> str:
    return json.dumps(outcome.plain(), indent=1, sort_keys=True) + "\n"


def _read(raw: bytes, name: str) -> FlightOutcome | None:
    try:
        plain: Any = json.loads(raw)
        outcome = outcome_of(plain)
        return outcome if outcome.name == name else None
    except (TypeError, ValueError, RecursionError, AttributeError):
        return None
