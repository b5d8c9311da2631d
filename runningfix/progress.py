"""Progress for callers from Python: bars in a terminal or a notebook, silence elsewhere, or a listener of theirs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from calibration.foundation.progress import Progress


@contextmanager
def bars(given: Progress | None) -> Iterator[Progress]:
    """`given`, or else a bar for each stage while this lasts."""
    if given is not None:
        yield given
        return
    shown: dict[str, tqdm[Any]] = {}

    def tell(stage: str, done: int, total: int) -> None:
        if stage not in shown:
            shown[stage] = tqdm(total=total or None, desc=stage, disable=not _watched(), leave=False)
        bar = shown[stage]
        bar.update(done - bar.n)
        if total and done >= total:
            bar.close()

    try:
        yield tell
    finally:
        for bar in shown.values():
            bar.close()


def _watched() -> bool:
    """Whether somebody sees standard error: a terminal, or a notebook's cell."""
    return "ipykernel" in sys.modules or sys.stderr.isatty()
