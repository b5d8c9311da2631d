"""Where the command line speaks: results on standard output, everything else on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from tqdm import tqdm


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
            print(json.dumps(summary, indent=1, allow_nan=False))  # noqa: T201
        elif not self.quiet:
            print(text)  # noqa: T201

    def error(self, text: str) -> None:
        """One message for one mistake."""
        self.close()
        print(f"runningfix: {text}", file=sys.stderr)  # noqa: T201
