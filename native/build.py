"""The build command that translates and compiles the loops."""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import Extension
from setuptools.command.build_ext import build_ext

from native.units import PACKAGE, written

ROOT = Path(__file__).resolve().parent.parent
INSTALLED = "runningfix"
"""The package below which everything is installed, see `scripts/wheel.py`."""


class BuildLoops(build_ext):
    """Writes the C text of every extension before it is compiled, and puts what was built where it is installed."""

    def build_extension(self, ext: Extension) -> None:
        """One extension; its text goes to the build folder."""
        source = Path(self.build_temp) / f"{ext.name.rpartition('.')[2]}.c"
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(written(ROOT, source.stem), encoding="utf-8")
        ext.sources, self.force = [str(source)], True
        super().build_extension(ext)

    def run(self) -> None:
        """Builds as always; then moves, unless it is built in place."""
        super().run()
        if self.inplace or self.editable_mode:
            return
        built = Path(self.build_lib)
        for path in built.joinpath(*PACKAGE.split(".")).glob("_native*"):
            place = built / INSTALLED / path.relative_to(built)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(path, place)
        shutil.rmtree(built / PACKAGE.partition(".")[0], ignore_errors=True)
