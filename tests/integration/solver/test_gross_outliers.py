"""A fifth of the sightings grossly wrong: the answer moves by less than its sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import CameraInput, SolverSettings
from pipeline.solver import solve
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_HIGH, simulate

SHARE, AWAY = 0.2, 0.1


def spoiled(camera: CameraInput, rng: np.random.Generator) -> CameraInput:
    """A fifth of the rays, drawn anew some hundred pixels (a tenth of the focal length) away."""
    ray = camera.rays.direction_cam.copy()
    wrong = rng.random(len(ray)) < SHARE
    ray[wrong] += rng.normal(0, AWAY, (int(wrong.sum()), 3))
    return replace(camera, rays=replace(camera.rays, direction_cam=ray / np.linalg.norm(ray, axis=1, keepdims=True)))


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_a_fifth_of_gross_outliers_moves_the_answer_by_less_than_its_sigma(robust) -> None:
    moves = []
    for seed in range(4):
        problem, _ = simulate(paper_scene(order=1, targets=2, offset_frames=3), noise=PAPER_HIGH, seed=seed)
        rng = np.random.default_rng(seed)
        bad = replace(problem, cameras=tuple(spoiled(c, rng) for c in problem.cameras))
        settings = SolverSettings(robust=robust)
        clean, dirty = solve(problem, settings), solve(bad, settings)
        assert dirty.status == "converged"
        for one, other in zip(clean.motions, dirty.motions, strict=True):
            time = np.linspace(one.start_s, one.end_s, 11)
            off = other.position_enu_m(time) - one.position_enu_m(time)
            sigma = np.sqrt(np.trace(one.position_covariance(time), axis1=1, axis2=2))
            moves.append((np.linalg.norm(off, axis=1) / sigma).max())
        clock, moved = clean.clocks[1], dirty.clocks[1]
        moves.append(abs(moved.offset_s - clock.offset_s) / clock.offset_sigma_s)
    assert max(moves) < 1.0
