"""Progress for callers from Python: bars in a terminal or a notebook, silence elsewhere, or a listener of theirs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from calibration.foundation.progress import Progress, silent


@contextmanager
def bars(given: Progress | None) -> Iterator[Progress]:
    """`given`, or else a bar for each stage while this lasts."""
    if given is not None or not _watched():
        yield given or silent
        return
    from rich import progress
    from rich.console import Console

    tasks: dict[str, progress.TaskID] = {}
    with progress.Progress(console=Console(stderr=True), transient=True) as shown:

        def tell(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=total or None)
            shown.update(tasks[stage], completed=done, total=total or None)

        yield tell


def _watched() -> bool:
    """Whether somebody sees it: a terminal, or a notebook that can show bars."""
    return sys.stderr.isatty() or ("ipykernel" in sys.modules and find_spec("ipywidgets") is not None)
