"""The check of the statistical limit flies: a script that nobody runs is soon a script that does not run."""

from __future__ import annotations

import numpy as np

from scripts.validation import check_solver_limit as script


def test_a_cell_is_flown_and_judged():
    cell = script.CELLS[-1]  # four targets, a rate that is 10 % wrong
    row = script.row_of(cell, script.Job(cell=cell, seeds=tuple(range(6)))())
    assert row.converged == 6
    assert 0.5 < row.over_bound < 1.6  # of six flights with four targets
    assert 0.5 < row.nees < 1.6
    assert np.isfinite(row.offset_sigmas)
