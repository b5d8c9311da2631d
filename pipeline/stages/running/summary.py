"""What a command did, and how long each part took."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from pipeline.records import Problem, Results


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSummary:
    """What a command did.

    files     written or found finished, relative to the output folder
    seconds   per stage; "solver" is the numerical solve alone
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


class StageSeconds:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Counts the time of a block for a stage."""
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin
