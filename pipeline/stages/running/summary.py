"""What a command did, and how long each part took."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from calibration.foundation.progress import Progress, silent
from pipeline.records import Problem, Results


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSummary:
    """What a command did.

    files     written or found finished, relative to the output folder
    seconds   per stage, which add up; "search", "solver" and "judge" are parts of "solve"
    skipped   stages found finished
    warnings  of all stages, also of those found finished
    results, problem  of `solve`, where it was done now
    """

    files: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    skipped: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    results: Results | None = None
    problem: Problem | None = None


WORDS = {
    "check": "check the flight", "read": "read tracks", "poses": "measure poses", "search": "search offsets",
    "solver": "adjust", "judge": "sigmas and verdict", "results": "gather results", "write": "write files",
}  # fmt: skip
"""How stages are said, where their name alone would not tell."""


class StageSeconds:
    """Seconds per stage, each of which is said as it begins."""

    def __init__(self, progress: Progress = silent) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of a block for a stage."""
        begin = time.perf_counter()
        said = WORDS.get(name, name)
        self._progress(said, 0, 1)
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
            self._progress(said, 1, 1)

    def add(self, seconds: Mapping[str, float]) -> None:
        """Counts what was counted elsewhere."""
        for name, value in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + value
