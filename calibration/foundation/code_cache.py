"""Compiled code, kept on disk under a stamp of what it is made of.

The stamp is a hash of byte code, constants and globals of the function and of every compiled function that it calls,
and of the options. Whatever changes, changes the stamp, so that stale code is never run; a comment changes nothing.
The folder is NUMBA_CACHE_DIR, else beside the source, else the user's cache folder; where none can be written, every
process compiles for itself.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
from collections.abc import Callable, Iterator
from types import CodeType, ModuleType
from typing import Any, cast

caching: Any = importlib.import_module("numba.core.caching")


def kept(dispatcher: Any, options: dict[str, Any]) -> Any:
    """The same compiled function, which looks for its code on disk before it compiles."""
    if not hasattr(dispatcher, "py_func"):  # NUMBA_DISABLE_JIT is set: it is the plain function
        return dispatcher
    with contextlib.suppress(RuntimeError):  # numba's word for: no folder can be written
        dispatcher._cache = _ContentCache(dispatcher.py_func, options)
    return dispatcher


class _ContentCache(caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache with a stamp of the content instead of the file; what cannot be read is not there."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function)
        self._made_of = function, options
        self._stamped = False

    def _stamp(self) -> None:
        """Done late: only when it is called are all functions defined that this one calls."""
        if not self._stamped:
            function, options = self._made_of
            name = f"{function.__module__}.{function.__qualname__}"
            self._cache_file = caching.IndexDataCacheFile(self._cache_path, name, fingerprint(function, options))
            self._stamped = True

    def load_overload(self, sig: object, target_context: object) -> object:
        """Compiled code, or None where there is none that can be used."""
        self._stamp()
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # cut short, or no longer readable: pickle raises nearly anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: object, data: object) -> None:
        """Keeps compiled code where it can be kept."""
        self._stamp()
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def fingerprint(function: Callable[..., Any], options: dict[str, Any]) -> str:
    """A hash of everything that the compiled function is made of."""
    digest = hashlib.sha256()
    for key, value in sorted(options.items()):
        digest.update(f"{key} = {sorted(value) if isinstance(value, set) else value}\n".encode())
    for line in _made_of(function, set()):
        digest.update(line.encode() + b"\n")
    return digest.hexdigest()


def _made_of(function: Callable[..., Any], seen: set[int]) -> Iterator[str]:
    """Its own code, its globals, and the same of the compiled functions among them."""
    function = cast("Callable[..., Any]", getattr(function, "py_func", function))
    if id(function) in seen:
        return
    seen.add(id(function))
    yield f"def {function.__module__}.{function.__qualname__} {function.__defaults__}"
    yield from _code(function.__code__)
    for name in sorted(_names(function.__code__)):
        value: Any = function.__globals__.get(name)
        if hasattr(value, "py_func"):
            yield from _made_of(value, seen)
        elif isinstance(value, ModuleType):
            yield f"{name} = {value.__name__} {getattr(value, '__version__', '')}"
        elif isinstance(value, type):
            yield f"{name} = {value.__module__}.{value.__qualname__} {getattr(value, '_fields', ())}"
        elif hasattr(value, "tobytes"):
            yield f"{name} = {value.dtype} {value.shape} {value.tobytes().hex()}"
        elif name in function.__globals__:
            yield f"{name} = {value!r}"


def _code(code: CodeType) -> Iterator[str]:
    """Byte code and constants, those of functions inside included."""
    yield code.co_code.hex()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)


def _names(code: CodeType) -> set[str]:
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*inner)
