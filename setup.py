"""The compiled loops, built ahead of time (`native/build.py`); everything else stands in pyproject.toml.

Where no C compiler is found the installation goes on without: numba then compiles loops as they are first called.
"""

import platform
import sys
from pathlib import Path

from setuptools import Extension, setup

sys.path.insert(0, str(Path(__file__).resolve().parent))

from native.units import FLAGS, LOOPS, NAME, WIDE


def extensions() -> list[Extension]:
    """Of each package one for every processor of the kind and, where that gains much, one for the better ones."""
    wide = WIDE if platform.machine() in ("x86_64", "AMD64") and sys.platform != "win32" else {}
    flags = ("/O2", "/std:c11") if sys.platform == "win32" else FLAGS
    return [
        Extension(f"{package}.{name}", [], extra_compile_args=[*flags, *more], optional=True)
        for package in LOOPS
        for name, more in {NAME: (), **wide}.items()
    ]


setup(ext_modules=extensions())
