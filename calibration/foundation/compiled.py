"""What the compiled twins of plain loops are compiled with; without numba they are left as they are and not used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

try:
    from numba import njit

    AVAILABLE = True
except ImportError:  # pragma: no cover - the extra is installed where the tests run
    AVAILABLE = False

    def njit(**_: object) -> Callable[[Any], Any]:  # type: ignore[no-redef]
        """Leaves functions as they are."""
        return lambda function: function


FAST: dict[str, Any] = {
    "cache": True, "fastmath": {"reassoc", "contract", "arcp", "nsz"}, "error_model": "numpy", "nogil": True
}  # fmt: skip
compiled = njit(**FAST)
inlined = njit(**FAST, inline="always")
