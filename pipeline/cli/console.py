"""Where the command line speaks: results on standard output, everything else on standard error.

On a terminal: one bar for each stage that runs. Elsewhere: a line at most every `LINE_EVERY_S` seconds, so that a log
shows what is done and that it goes on.
"""

from __future__ import annotations

import json
import math
import sys
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

    def __init__(self, *, quiet: bool = False, verbose: bool = False, as_json: bool = False) -> None:
        self.quiet, self.verbose, self.as_json = quiet, verbose, as_json
        self.bars: dict[str, TaskID] = {}
        self.drawn: Progress | None = None
        self.told_s = time.monotonic()

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
        elif time.monotonic() - self.told_s >= LINE_EVERY_S:
            self.told_s = time.monotonic()
            share = f" of {total} ({100 * done / total:.0f} %)" if total else ""
            self.say(f"{stage}: {done}{share}")

    def _move(self, stage: str, done: int, total: int) -> None:
        if self.drawn is None:
            self.drawn = _bars()
            self.drawn.start()
        if stage not in self.bars:
            self.bars[stage] = self.drawn.add_task(stage, total=total or None)
        ended = bool(total) and done >= total
        self.drawn.update(self.bars[stage], completed=done, total=total or None, visible=not ended)

    def close(self) -> None:
        """Ends every bar."""
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
