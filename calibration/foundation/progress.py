"""How a stage tells how far it is, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol


class Progress(Protocol):
    """Listener: `(stage, done, total)`; silent by default."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """`done` of `total` steps of `stage` are finished."""


def silent(stage: str, done: int, total: int) -> None:
    """Tells nobody."""


Part = Callable[[str], AbstractContextManager[None]]
"""What is told that a part of a computation, by its name, lasts as long as the block."""


def uncounted(name: str) -> AbstractContextManager[None]:
    """Tells nobody."""
    return nullcontext()
