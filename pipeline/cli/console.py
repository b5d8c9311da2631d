"""Where the command line speaks: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from typing import Any

from tqdm import tqdm

from calibration.foundation.errors import WriteError


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
    """Messages, one progress bar at a time for each stage, and results."""

    def __init__(self, *, quiet: bool = False, verbose: bool = False, as_json: bool = False) -> None:
        self.quiet, self.verbose, self.as_json = quiet, verbose, as_json
        self.bars: dict[str, tqdm[Any]] = {}

    def say(self, text: str) -> None:
        """A message, unless quiet."""
        if not self.quiet:
            tqdm.write(text, file=sys.stderr)

    def detail(self, text: str) -> None:
        """A message only for --verbose."""
        if self.verbose:
            self.say(text)

    def progress(self, stage: str, done: int, total: int) -> None:
        """Moves the bar of `stage`; silent where standard error is no terminal."""
        bar = self.bars.get(stage)
        if bar is None:
            hidden = self.quiet or not sys.stderr.isatty()
            bar = self.bars[stage] = tqdm(
                total=total or None, desc=stage, disable=hidden, leave=False, file=sys.stderr, dynamic_ncols=True
            )
        bar.update(done - bar.n)
        if total and done >= total:
            bar.close()

    def close(self) -> None:
        """Ends every bar."""
        for bar in self.bars.values():
            bar.close()

    def result(self, summary: Mapping[str, Any], text: str) -> None:
        """The command's result: JSON where that was asked for, else `text`."""
        self.close()
        if self.as_json:
            self._print(json.dumps(_finite(summary), indent=1, allow_nan=False, default=str))
        elif not self.quiet:
            self._print(text)

    def _print(self, text: str) -> None:
        """To standard output, at once. Raises OutputClosedError where nobody reads it."""
        try:
            if sys.stdout is not None:
                print(text, flush=True)  # noqa: T201
            elif self.as_json:
                raise BrokenPipeError
        except (BrokenPipeError, ValueError):
            raise OutputClosedError from None

    def error(self, text: str) -> None:
        """One message for one mistake."""
        self.close()
        print(f"runningfix: {text}", file=sys.stderr)  # noqa: T201


def _finite(value: Any) -> Any:
    """`value` with null for numbers that JSON does not know."""
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
