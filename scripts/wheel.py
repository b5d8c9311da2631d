"""How the project is installed: as one package, `runningfix`, so that nothing of ours takes a common name.

In the source `pipeline` and `calibration` lie at the top; in a wheel they are `runningfix.pipeline` and
`runningfix.calibration`, and their import statements say so. Only statements are rewritten, never text: code that needs
its own name at run time asks for `__name__` or `__package__`. An editable install leaves the source as it is.
"""

from __future__ import annotations

import ast
import os
import shutil
from pathlib import Path

from setuptools.command.build_py import build_py
from setuptools.command.egg_info import egg_info

ROOT = "runningfix"
MOVED = ("calibration", "pipeline")


def rewritten(source: str, name: str = "<source>") -> str:
    """`source` with every import of a moved package as an import of what it is called when it is installed.

    Raises ValueError at a form of import that would bind another name then.
    """
    lines = source.encode().splitlines(keepends=True)
    for node in ast.walk(ast.parse(source, name)):
        if isinstance(node, ast.Import):
            _refuse(node, name)
        elif isinstance(node, ast.ImportFrom) and not node.level and _top(node.module or "") in MOVED:
            line, module = lines[node.lineno - 1], (node.module or "").encode()
            at = line.index(module, node.col_offset + len(b"from"))
            lines[node.lineno - 1] = line[:at] + f"{ROOT}.".encode() + line[at:]
    return b"".join(lines).decode()


def _refuse(node: ast.Import, name: str) -> None:
    for imported in node.names:
        if _top(imported.name) in MOVED:
            raise ValueError(f"{name}, line {node.lineno}: write `from ... import`, not `import {imported.name}`")


def _top(module: str) -> str:
    return module.partition(".")[0]


class BuildPy(build_py):
    """Copies the packages to where they are installed, with their imports rewritten."""

    def run(self) -> None:
        """Builds as always; then moves, unless the install is an editable one."""
        super().run()
        if self.editable_mode:
            return
        built = Path(self.build_lib)
        for package in MOVED:
            shutil.rmtree(built / ROOT / package, ignore_errors=True)
            shutil.move(built / package, built / ROOT / package)
        for path in sorted((built / ROOT).rglob("*.py")):
            path.write_text(rewritten(path.read_text(encoding="utf-8"), str(path)), encoding="utf-8")

    def get_source_files(self) -> list[str]:
        """What a source distribution needs, this file included."""
        return [*super().get_source_files(), os.path.join("scripts", "wheel.py")]


class EggInfo(egg_info):
    """Metadata that names the one package that is installed."""

    def write_file(self, what: str, filename: str, data: str) -> None:
        """As always, but for the list of packages at the top."""
        super().write_file(what, filename, f"{ROOT}\n" if os.path.basename(filename) == "top_level.txt" else data)
