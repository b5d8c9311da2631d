"""The claimed uncertainty is true: `map` sits on its own covariance, which is the Cramer-Rao bound's estimate."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pipeline.geometry.splines import acting
from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_HIGH, PAPER_LOW, simulate

SEEDS = 30


def normalised_errors(motion, true):
    """Squared error of all coefficients over their covariance, per degree of freedom; and mean square and variance."""
    k = motion.degree
    nodes = np.linspace(motion.start_s, motion.end_s, k + 1)
    path = CubicSpline(true.time_s, true.position_enu_m)
    error = (motion.position_enu_m(nodes) - path(nodes)).ravel()
    basis = acting(motion.knots_s, k, np.full(k + 1, k), nodes)
    blocks = np.zeros((k + 1, k + 1, 3, 3))
    for i in range(k + 1):
        for j in range(k + 1 - i):
            blocks[i, i + j] = motion.covariance_band[i, j]
            blocks[i + j, i] = motion.covariance_band[i, j].T
    covariance = np.einsum("ai,ijxy,bj->axby", basis, blocks, basis).reshape(3 * (k + 1), -1)
    time = np.linspace(motion.start_s, motion.end_s, 21)
    square = ((motion.position_enu_m(time) - path(time)) ** 2).sum(axis=1).mean()
    variance = np.trace(motion.position_covariance(time), axis1=1, axis2=2).mean()
    return error @ np.linalg.solve(covariance, error) / len(error), square, variance


@pytest.mark.parametrize(("noise", "rate"), [(PAPER_LOW, 10.0), (PAPER_HIGH, 9.0)])
def test_map_sits_on_the_bound(noise, rate):
    found, offset = [], []
    scene = paper_scene(order=1, targets=1, offset_frames=3, given_rate_hz=rate)
    for seed in range(SEEDS):
        problem, truth = simulate(scene, noise=noise, seed=seed)
        solution = solve(problem, SolverSettings())
        assert solution.status == "converged"
        found.append(normalised_errors(solution.motions[0], truth.trajectories[0]))
        clock = solution.clock("uav2")
        offset.append((clock.offset_s - truth.offset_s["uav2"]) / clock.offset_sigma_s)
    nees, square, variance = np.mean(found, axis=0)
    assert 0.75 < nees < 1.25  # 30 seeds of 6 degrees of freedom: 0.1 either way is chance
    assert np.sqrt(square / variance) < 1.15
    assert np.sqrt(np.mean(np.square(offset))) < 1.4
