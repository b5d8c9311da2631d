"""Redundancies are what squared residuals are on average, drawn apart from the solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from tests.unit.solver.observability.test_findings import CURVED, STILL_SOUTH, Cam, poly, scene

SEEDS = 14


def test_redundancies_are_the_mean_squared_residuals() -> None:
    flown = paper_scene(order=1, targets=2, offset_frames=3)
    runs = [
        solve(simulate(flown, noise=PAPER_LOW, seed=seed)[0], SolverSettings(robust="none")).redundancies
        for seed in range(SEEDS)
    ]
    assert [(r.kind, r.subject) for r in runs[0]] == [
        ("camera", "uav1"),
        ("camera", "uav2"),
        ("target", "target1"),
        ("target", "target2"),
    ]
    for i, one in enumerate(runs[0]):
        left, square = (np.mean([getattr(r[i], key) for r in runs]) for key in ("redundancy", "chi_square"))
        assert 0 < left < one.equations
        assert square == pytest.approx(left, rel=5 * np.sqrt(2 / left / SEEDS)), one  # five of its own sigmas


def test_cameras_and_targets_share_out_the_same_redundancy() -> None:
    targets = [poly([0, 0, 0], [8, 3, 0], [-1.5, 1, 0]), poly([20, 10, 0], [-4, 7, 0], [1, 1.5, 0])]
    problem = scene([Cam(CURVED), Cam(STILL_SOUTH, tell_offset=True)], targets, order=None)
    found = solve(problem, SolverSettings()).redundancies
    by_kind = {k: sum(r.redundancy for r in found if r.kind == k) for k in ("camera", "target")}
    assert by_kind["camera"] == pytest.approx(by_kind["target"])
    assert all(0 < r.redundancy < r.equations == 400 for r in found)


def test_unit_weight_is_judged_by_chi_square() -> None:
    problem = scene([Cam(CURVED), Cam(STILL_SOUTH, tell_offset=True)], [poly([0, 0, 0], [8, 3, 0])])
    solution = solve(problem, SolverSettings(robust="none"))
    test = solution.unit_weight
    assert test is not None
    assert test.passed
    free = solution.expected_chi_square  # the true redundancy, which counts what priors decide
    assert free == pytest.approx(solution.degrees_of_freedom, rel=1e-3)
    assert test.low * free == pytest.approx(chi2.isf(0.975, free))
    assert test.variance_factor == pytest.approx(solution.chi_square / free)
    assert solve(problem, SolverSettings(method="algorithm-1")).unit_weight is None
