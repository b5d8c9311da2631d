"""Where the command line speaks: results on standard output, everything else on standard error.

On a terminal: one bar for each stage that runs. Elsewhere: a line every `LINE_EVERY_S` seconds, so that a log shows
what is done and that it goes on, also where one step takes minutes.
"""

from __future__ import annotations

import json
import math
import os
import sys
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from calibration.foundation.errors import WriteError

if TYPE_CHECKING:  # rich is imported where something is drawn, so that help is quick
    from rich.console import Console as Drawn
    from rich.console import RenderableType
    from rich.progress import Progress, TaskID

LINE_EVERY_S = 5.0
PIPED_COLUMNS = 132
"""Width of results that go into a file or another program: nothing is wrapped that fits this."""


class OutputClosedError(WriteError):
    """Standard output is closed, or was before the result was written."""

    def __init__(self) -> None:
        super().__init__(
            where="standard output",
            seen="closed before the result was written",
            expected="somebody who reads it",
            advice="the files are written; keep the output with > result.json",
        )


class Console:
    """Messages, the progress of each stage, and results."""

    def __init__(
        self, *, quiet: bool = False, verbose: bool = False, as_json: bool = False, age_s: float = 0.0
    ) -> None:
        """`age_s` is how long ago the command was given."""
        self.quiet, self.verbose, self.as_json = quiet, verbose, as_json
        self.bars: dict[str, TaskID] = {}
        self.drawn: Progress | None = None
        self.told_s = time.monotonic()
        self.began_s = self.told_s - age_s
        self.doing = ""
        self.ended: threading.Event | None = None

    def since_start_s(self) -> float:
        """Seconds since the command was given."""
        return time.monotonic() - self.began_s

    def say(self, text: str) -> None:
        """A message, unless quiet."""
        if self.quiet or sys.stderr is None:
            return
        if self.drawn is not None:
            self.drawn.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            print(text, file=sys.stderr)  # noqa: T201

    def detail(self, text: str) -> None:
        """A message only for --verbose."""
        if self.verbose:
            self.say(text)

    def progress(self, stage: str, done: int, total: int) -> None:
        """Moves the bar of `stage`, or says a line now and then where standard error is no terminal."""
        if self.quiet or sys.stderr is None:
            return
        if sys.stderr.isatty():
            self._move(stage, done, total)
            return
        share = f" of {total} ({100 * done / total:.0f} %)" if total else ""
        self.doing = f"{stage}: {done}{share}" if total != 1 else stage
        if self.ended is None:
            self.ended = threading.Event()
            threading.Thread(target=self._keep_telling, args=(self.ended,), daemon=True).start()
        if (total != 1 or done < total) and time.monotonic() - self.told_s >= LINE_EVERY_S:
            self._tell()

    def _tell(self) -> None:
        self.told_s = time.monotonic()
        self.say(self.doing)

    def _keep_telling(self, ended: threading.Event) -> None:
        """Says what is being done where nothing was said for long, until the end."""
        told_s = self.told_s
        while not ended.wait(LINE_EVERY_S):
            if self.told_s == told_s:
                self._tell()
            told_s = self.told_s

    def _move(self, stage: str, done: int, total: int) -> None:
        if self.drawn is None:
            self.drawn = _bars()
            self.drawn.start()
        known = total if total > 1 else None  # of one step no share is done: the bar goes to and fro
        if stage not in self.bars:
            self.bars[stage] = self.drawn.add_task(stage, total=known)
        ended = bool(total) and done >= total
        self.drawn.update(self.bars[stage], completed=done, total=known, visible=not ended)

    def close(self) -> None:
        """Ends every bar, and the telling."""
        if self.ended is not None:
            self.ended.set()
            self.ended = None
        if self.drawn is not None:
            self.drawn.stop()
        self.drawn = None
        self.bars.clear()

    def result(self, summary: Mapping[str, Any], shown: RenderableType) -> None:
        """The command's result: JSON where that was asked for, else what is `shown` to people."""
        self.close()
        if self.as_json:
            self._print(json.dumps(_finite(summary), indent=1, allow_nan=False, default=str))
        elif not self.quiet:
            self._print(shown)

    def _print(self, shown: RenderableType) -> None:
        """To standard output, at once. Raises OutputClosedError where nobody reads it."""
        try:
            if sys.stdout is None:
                if self.as_json:
                    raise BrokenPipeError
            elif isinstance(shown, str):
                print(shown, flush=True)  # noqa: T201
            else:
                paper().print(shown)
                sys.stdout.flush()
        except (BrokenPipeError, ValueError):
            raise OutputClosedError from None

    def error(self, text: str) -> None:
        """One message for one mistake."""
        self.close()
        print(f"runningfix: {text}", file=sys.stderr)  # noqa: T201


def process_age_s() -> float:
    """Seconds since this process began; 0 where the system does not tell."""
    try:
        with open("/proc/self/stat") as file:
            ticks = int(file.read().rpartition(")")[2].split()[19])  # starttime, proc(5)
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK"))
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0


def paper() -> Drawn:
    """Standard output as rich draws on it: coloured on a terminal, plain and wide elsewhere."""
    from rich.console import Console as Drawn

    width = None if sys.stdout.isatty() else PIPED_COLUMNS
    return Drawn(file=sys.stdout, width=width, highlight=False, markup=False, emoji=False)


def _bars() -> Progress:
    from rich.console import Console as Drawn
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TimeRemainingColumn(), console=Drawn(stderr=True), transient=True,
    )  # fmt: skip


def _finite(value: Any) -> Any:
    """`value` with null for numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
