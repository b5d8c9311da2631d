"""How the compiled twins of plain loops are compiled: ahead of time where the installation brings them (`prebuilt`),
else by numba on their first call; without either they are left as they are and not used.

numba is slow to import, so it is imported where the first loop is compiled, not with this module. Compiled code is kept
on disk (`code_cache`).
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
from collections.abc import Callable, Iterator
from typing import Any, Literal, TypeVar, cast

from calibration.foundation.prebuilt import CHOICE, extension, prebuilt

AVAILABLE = os.environ.get(CHOICE, "") != "none" and importlib.util.find_spec("numba") is not None
"""Whether loops can be compiled as they are called; without the extra `fast` they cannot."""

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


def how_compiled(module: str) -> Literal["ahead", "when called", "no"]:
    """How the loops of a module are compiled here."""
    if extension(module.rpartition(".")[0]) is not None:
        return "ahead"
    return "when called" if AVAILABLE else "no"


def is_compiled(module: str) -> bool:
    """Whether the loops of a module are compiled: built ahead, or by numba."""
    return how_compiled(module) != "no"


def _compiled(function: F, options: dict[str, Any]) -> F:
    built = prebuilt(function)
    if built is not None:
        return cast(F, built)
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
