"""Compiled loops that came with the installation, built ahead of time (`native/`), for `compiled`.

An extension is used only where it was built from the very text of the files that it stands for; else, and where there
is none, numba compiles loops as they are first called. `RUNNINGFIX_COMPILED` chooses: "jit" asks for numba, "none" for
plain numpy.
"""

from __future__ import annotations

import functools
import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

CHOICE = "RUNNINGFIX_COMPILED"
NAME = "_native"


@functools.cache
def extension(package: str) -> Any:
    """The extension of a package's loops, best for this processor; None where none was built of this source."""
    if os.environ.get(CHOICE, "") in ("jit", "none") or not package:
        return None
    base = _imported(f"{package}.{NAME}")
    if base is None or base.stamp != stamp(base):
        return None
    best = _imported(f"{package}.{base.best}") if base.best else None
    return best if best is not None and best.stamp == base.stamp else base


def _imported(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def stamp(extension: Any) -> str:
    """A hash of the files as they now lie beside an extension that names them."""
    import hashlib  # where there is an extension: it takes a hundredth of a second

    digest = hashlib.sha256()
    for name in extension.files.split():
        try:
            text = (Path(extension.__file__).parent / name).read_bytes().replace(b"\r\n", b"\n")
        except OSError:
            return ""
        digest.update(text.replace(b"from runningfix.", b"from "))  # as it was before it was installed
    return digest.hexdigest()


def prebuilt(function: Callable[..., Any]) -> Callable[..., Any] | None:
    """The function built ahead of time; itself where only others that were built call it; None: not built."""
    package, _, module = function.__module__.rpartition(".")
    found = extension(package)
    if found is None or f"{module}.py" not in found.files.split():
        return None
    built: Callable[..., Any] = getattr(found, f"{module}:{function.__name__}", function)
    return built
