"""What the compiled twins of plain loops are compiled with; without numba they are left as they are and not used.

numba is slow to import, so it is imported where the first loop is compiled, not with this module. Compiled code is kept
on disk (`code_cache`).
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

AVAILABLE = importlib.util.find_spec("numba") is not None
"""Whether loops are compiled; without the extra `fast` they are not."""

FAST: dict[str, Any] = {
    "fastmath": {"reassoc", "contract", "arcp", "nsz"}, "error_model": "numpy", "nogil": True
}  # fmt: skip
"""Of loops over numbers: sums may be reordered, but infinities and NaN mean what they mean."""
EXACT: dict[str, Any] = {"nogil": True}
F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: Callable[..., Any]) -> Any:
    """The function as fast as it gets, compiled on its first call."""
    return _compiled(function, FAST)


def inlined(function: Callable[..., Any]) -> Any:
    """The function as a part of those that call it."""
    return _compiled(function, {**FAST, "inline": "always"})


def loop(function: F) -> F:
    """`function` compiled as it stands, for bytes and whole numbers, and typed as it was."""
    return _compiled(function, EXACT)


def _compiled(function: F, options: dict[str, Any]) -> F:
    if not AVAILABLE:  # pragma: no cover - the extra is installed where the tests run
        return function
    from numba import njit

    from calibration.foundation.code_cache import kept

    return cast(F, kept(njit(**options)(function), options))


@contextlib.contextmanager
def announced(say: Callable[[str], None]) -> Iterator[None]:
    """While this lasts, `say` is told the name of every function that is about to be compiled (not loaded)."""
    if not AVAILABLE:  # pragma: no cover - the extra is installed where the tests run
        yield
        return
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, happening: Any) -> None:
            say(str(happening.data["dispatcher"].py_func.__name__).lstrip("_"))

        def on_end(self, happening: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield
