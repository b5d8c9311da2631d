"""The build command that translates and compiles the loops."""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import Extension
from setuptools.command.build_ext import build_ext

from native.units import LOOPS, written

ROOT = Path(__file__).resolve().parent.parent
INSTALLED = "runningfix"
"""The package below which everything is installed, see `scripts/wheel.py`."""


class BuildLoops(build_ext):
    """Writes the C text of every extension before it is compiled, and puts what was built where it is installed."""

    def build_extension(self, ext: Extension) -> None:
        """One extension; its text goes to the build folder."""
        package, _, name = ext.name.rpartition(".")
        source = Path(self.build_temp) / package / f"{name}.c"
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(written(ROOT, package, name), encoding="utf-8")
        ext.sources, self.force = [str(source)], True
        super().build_extension(ext)

    def run(self) -> None:
        """Builds as always; then moves, unless it is built in place."""
        super().run()
        if self.inplace or self.editable_mode:
            return
        built = Path(self.build_lib)
        for package in LOOPS:
            for path in built.joinpath(*package.split(".")).glob("_native*"):
                place = built / INSTALLED / path.relative_to(built)
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.move(path, place)
        for top in {package.partition(".")[0] for package in LOOPS}:
            shutil.rmtree(built / top, ignore_errors=True)
