"""Builds the compiled loops ahead of time; everything else stands in pyproject.toml.

Where no C compiler is found the installation goes on without: numba then compiles loops as they are first called.
"""

import platform
import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from native.units import FLAGS, NAME, PACKAGE, WIDE, written  # noqa: E402


class BuildLoops(build_ext):
    """Writes the C text of every extension before it is compiled."""

    def build_extension(self, ext: Extension) -> None:
        """One extension; its text goes to the build folder."""
        source = Path(self.build_temp) / f"{ext.name.rpartition('.')[2]}.c"
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(written(ROOT, source.stem), encoding="utf-8")
        ext.sources = [str(source)]
        super().build_extension(ext)


def extensions() -> list[Extension]:
    """One for every processor of the kind and, where that gains much, one for the better ones."""
    wide = WIDE if platform.machine() in ("x86_64", "AMD64") and sys.platform != "win32" else {}
    flags = ("/O2", "/std:c11") if sys.platform == "win32" else FLAGS
    return [
        Extension(f"{PACKAGE}.{name}", [], extra_compile_args=[*flags, *more], optional=True)
        for name, more in {NAME: (), **wide}.items()
    ]


setup(ext_modules=extensions(), cmdclass={"build_ext": BuildLoops})
