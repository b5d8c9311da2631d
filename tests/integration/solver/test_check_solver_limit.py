"""The check of the statistical limit flies: a script that nobody runs is soon a script that does not run."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np

SCRIPT = Path(__file__).resolve().parents[3] / "scripts" / "check_solver_limit.py"


def test_a_cell_is_flown_and_judged(monkeypatch):
    spec = importlib.util.spec_from_file_location("check_solver_limit", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "check_solver_limit", script)  # where its dataclasses look for their names
    spec.loader.exec_module(script)
    cell = script.CELLS[-1]  # four targets, a rate that is 10 % wrong
    row = script.row_of(cell, script.Job(cell=cell, seeds=tuple(range(6)))())
    assert row.converged == 6
    assert 0.5 < row.over_bound < 1.6  # of six flights with four targets
    assert 0.5 < row.nees < 1.6
    assert np.isfinite(row.offset_sigmas)
