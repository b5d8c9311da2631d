"""What the compiled twins of plain loops are compiled with; without numba they are left as they are and not used.

numba is slow to import, so it is imported where the first loop is compiled, not with this module.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any, TypeVar, cast

AVAILABLE = importlib.util.find_spec("numba") is not None
"""Whether loops are compiled; without the extra `fast` they are not."""

FAST: dict[str, Any] = {
    "cache": True, "fastmath": {"reassoc", "contract", "arcp", "nsz"}, "error_model": "numpy", "nogil": True
}  # fmt: skip
F = TypeVar("F", bound=Callable[..., object])


def _njit(**options: Any) -> Any:
    def decorate(function: Any) -> Any:
        if not AVAILABLE:  # pragma: no cover - the extra is installed where the tests run
            return function
        from numba import njit

        return njit(**options)(function)

    return decorate


compiled = _njit(**FAST)
inlined = _njit(**FAST, inline="always")


def loop(function: F) -> F:
    """`function` compiled as it stands, for bytes and whole numbers, and typed as it was."""
    return cast(F, _njit(cache=True, nogil=True)(function))
