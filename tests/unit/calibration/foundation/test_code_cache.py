"""Compiled code is kept under what it is made of, and where nothing can be kept it is compiled all the same."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba")
from calibration.foundation.code_cache import fingerprint

INNER = """from calibration.foundation.compiled import loop
{before}
WORTH = {worth}
@loop
def inner(x):
    return {said}
"""
OUTER = """from calibration.foundation.compiled import loop
from made_inner import inner
@loop
def outer(x):
    return inner(x) + 1
"""
ASK = "import made_outer; print(made_outer.outer(2), made_outer.outer._cache_hits.total())"


def write(folder: Path, said: str = "x * WORTH", worth: int = 10, before: str = "") -> None:
    """A compiled function in one file that calls another in another file."""
    (folder / "made_inner.py").write_text(INNER.format(said=said, worth=worth, before=before))
    (folder / "made_outer.py").write_text(OUTER)


def ask(folder: Path, **environment: str) -> list[str]:
    """What a new process gets from the outer function, and how often it found code on disk."""
    given = {**os.environ, "PYTHONPATH": f"{folder}:{Path(__file__).parents[4]}", **environment}
    found = subprocess.run([sys.executable, "-c", ASK], env=given, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return found.stdout.split()


def test_code_is_kept_and_never_stale(tmp_path: Path) -> None:
    write(tmp_path)
    assert ask(tmp_path) == ["21", "0"]
    assert ask(tmp_path) == ["21", "1"]
    write(tmp_path, before="# a comment, and another line")
    assert ask(tmp_path) == ["21", "1"], "a comment compiles nothing anew"
    write(tmp_path, worth=20)
    assert ask(tmp_path) == ["41", "0"], "a constant of the callee"
    write(tmp_path, said="x - WORTH")
    assert ask(tmp_path) == ["-7", "0"], "the code of the callee"


def test_code_that_cannot_be_read_is_compiled_again(tmp_path: Path) -> None:
    write(tmp_path)
    kept = tmp_path / "kept"
    ask(tmp_path, NUMBA_CACHE_DIR=str(kept))
    files = [file for file in kept.rglob("*") if file.is_file()]
    assert len(files) >= 2
    for file in files:
        file.write_bytes(file.read_bytes()[:100])
    assert ask(tmp_path, NUMBA_CACHE_DIR=str(kept)) == ["21", "0"]


def test_without_a_folder_to_write_it_compiles(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "__pycache__").write_text("a file where the folder would be")
    nowhere = str(tmp_path / "made_inner.py" / "none")
    assert ask(tmp_path, NUMBA_CACHE_DIR=nowhere, HOME=nowhere, XDG_CACHE_HOME=nowhere) == ["21", "0"]


def test_options_are_part_of_the_stamp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    outer = importlib.import_module("made_outer").outer
    assert fingerprint(outer, {"nogil": True}) != fingerprint(outer, {"nogil": False})
    assert fingerprint(outer, {"fastmath": {"nsz", "arcp"}}) == fingerprint(outer, {"fastmath": {"arcp", "nsz"}})


def test_what_is_compiled_is_announced_and_what_is_loaded_is_not(tmp_path: Path) -> None:
    write(tmp_path)
    told = "from calibration.foundation.compiled import announced; import made_outer; names = []"
    tell = f"{told}\nwith announced(names.append): made_outer.outer(2)\nprint(*names)"
    given = {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[4]}"}
    for wanted in (["outer", "inner"], []):
        found = subprocess.run([sys.executable, "-c", tell], env=given, capture_output=True, text=True, check=True)
        assert found.stdout.split() == wanted


def test_where_compiling_is_switched_off_the_plain_function_runs(tmp_path: Path) -> None:
    write(tmp_path)
    code = "import made_outer; print(made_outer.outer(2))"
    given = {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[4]}", "NUMBA_DISABLE_JIT": "1"}
    found = subprocess.run([sys.executable, "-c", code], env=given, capture_output=True, text=True, check=True)
    assert found.stdout == "21\n"
