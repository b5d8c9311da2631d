"""Compile a loop where numba is installed; else the same source runs as plain Python."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import TypeVar, cast

COMPILED = importlib.util.find_spec("numba") is not None
"""Whether loops are compiled; without the extra `fast` they are not."""

F = TypeVar("F", bound=Callable[..., object])


def loop(function: F) -> F:
    """`function` compiled to machine code (kept on disk beside the module), or as it is."""
    if not COMPILED:
        return function
    import numba

    return cast(F, numba.njit(cache=True, nogil=True)(function))
