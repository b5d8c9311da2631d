"""Targets that look lively because of what a camera's poses did are doubted; those that are lively are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.geometry.rotation import exp, multiply
from pipeline.records import Problem, Solution, SolverSettings, TargetInput
from pipeline.solver import solve
from pipeline.solver.methods.simple_motions import SIMPLE
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

SURE = replace(PAPER_LOW, attitude_bias_rad=5e-4, attitude_rad=5e-4, position_bias_m=0.05, position_m=0.02)


def straight(targets: int = 3) -> Problem:
    problem, _ = simulate(paper_scene(targets=targets, given_offset_s=0.5), noise=SURE, seed=1)
    asked = tuple(TargetInput(target=t.target) for t in problem.targets)
    first, second = problem.cameras
    known = replace(second.sigma, offset_s=0.02, frame_rate=1e-3)
    return replace(problem, targets=asked, cameras=(first, replace(second, sigma=known)))


def turned(problem: Problem, angle_rad: float) -> Problem:
    """The second camera's attitude off by what swings by `angle_rad` to each side within its video."""
    camera = problem.cameras[1]
    share = np.linspace(-np.pi, np.pi, len(camera.poses.frame))
    axis = np.array([0.3, 1.0, 0.2]) * angle_rad
    enu_from_cam = multiply(camera.poses.enu_from_cam, exp(np.sin(share)[:, None] * axis))
    return replace(
        problem, cameras=(problem.cameras[0], replace(camera, poses=replace(camera.poses, enu_from_cam=enu_from_cam)))
    )


def doubts(solution: Solution) -> list[str]:
    return [r.subject for r in solution.verdict.reasons if r.kind == "motions-or-poses"]


def test_an_attitude_that_swings_is_named_where_straight_targets_seem_to_wind() -> None:
    solution = solve(turned(straight(), 0.01), SolverSettings())
    assert all(m.kind == "spline" or m.degree > SIMPLE for m in solution.motions)
    assert doubts(solution)
    assert "uav2" in doubts(solution)[0]
    words = next(r.words for r in solution.verdict.reasons if r.kind == "motions-or-poses")
    assert "uav2 0." in words
    assert "degrees off by errors that last" in words
    assert solution.verdict.grade != "good"


@pytest.mark.parametrize("order", [1, 4])
def test_targets_that_go_simply_or_turn_themselves_are_not_doubted(order: int) -> None:
    problem = straight()
    if order > 1:
        problem, _ = simulate(paper_scene(order=order, targets=3, given_offset_s=0.5), noise=SURE, seed=1)
        problem = replace(
            problem, targets=tuple(TargetInput(target=t.target, motion="spline") for t in problem.targets)
        )
    assert not doubts(solve(problem, SolverSettings()))
