#!/usr/bin/env python
"""The notebooks of docs/notebooks, executed without Jupyter: each cell in turn, its output kept in the file.

python -m scripts.notebooks FOLDER    # a copy of data/flight that was calibrated and run as the tutorial says

A value that a cell ends with is shown as Jupyter shows it (text, tables also as HTML), what it prints as a stream, its
figures as pictures. Nothing of the machine gets into the files: cells name files relative to FOLDER.
"""

from __future__ import annotations

import argparse
import ast
import base64
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

NOTEBOOKS = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
DPI = 64


def executed(notebook: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The notebook with the outputs that its cells have in `folder`. Raises what a cell raises."""
    os.environ.setdefault("MPLBACKEND", "Agg")
    names: dict[str, Any] = {"__name__": "__main__"}
    cells, count = [], 0
    with contextlib.chdir(folder):
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                count += 1
                cell = {**cell, "execution_count": count, "outputs": _outputs("".join(cell["source"]), names, count)}
            cells.append(cell)
    return {**notebook, "cells": cells}


def _outputs(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """What a cell prints, draws and ends with; a value behind a semicolon is not shown."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "<cell>", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    found: list[dict[str, Any]] = []
    if printed.getvalue():
        found.append({"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())})
    if value is not None and not source.rstrip().endswith(";"):
        data = {"text/plain": _lines(repr(value))}
        if hasattr(value, "to_html"):
            data["text/html"] = _lines(value.to_html(border=0))
        found.append({"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": data})
    return [*found, *_pictures()]


def _pictures() -> list[dict[str, Any]]:
    if "matplotlib.pyplot" not in sys.modules:
        return []
    from matplotlib import pyplot

    found = []
    for number in pyplot.get_fignums():
        picture = io.BytesIO()
        pyplot.figure(number).savefig(picture, dpi=DPI, bbox_inches="tight", metadata={"Software": None})
        encoded = base64.b64encode(picture.getvalue()).decode("ascii")
        data = {"image/png": encoded, "text/plain": ["<figure>"]}
        found.append({"output_type": "display_data", "metadata": {}, "data": data})
    pyplot.close("all")
    return found


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def main() -> int:
    """Executes every notebook and writes it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="a finished copy of data/flight")
    folder = parser.parse_args().folder.resolve()
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        done = executed(json.loads(path.read_text(encoding="utf-8")), folder)
        path.write_text(json.dumps(done, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
