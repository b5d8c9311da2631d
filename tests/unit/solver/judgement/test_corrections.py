"""Corrections are the estimates less their priors, in their own units; the verdict rests on the same figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import Problem, Solution, SolverSettings
from pipeline.solver import solve
from tests.scenes import mistaken

GIVEN_S = 0.52


def solved(problem: Problem) -> Solution:
    return solve(problem, SolverSettings())


@pytest.fixture(scope="module")
def found() -> Solution:
    problem = mistaken.right_flight(1)
    for camera in problem.cameras:
        sigma = replace(camera.sigma, focal=0.003, offset_s=0.5, frame_rate=0.001)
        problem = mistaken.with_camera(problem, camera.camera, sigma=sigma, offset_s=GIVEN_S)
    return solved(problem)


def test_every_free_parameter_with_a_prior_has_a_row_in_the_order_of_the_shared_ones(found: Solution) -> None:
    assert tuple(c.parameter for c in found.corrections) == found.shared_names
    assert {c.block for c in found.corrections} >= {"attitude", "position", "focal", "offset", "frame-rate"}


def test_values_and_sigmas_are_those_of_the_solution(found: Solution) -> None:
    rows = {c.parameter: c for c in found.corrections}
    bias, clock = next(b for b in found.biases if b.camera == "uav2"), found.clock("uav2")
    expected = {
        "rotation_bias_y_rad": (bias.rotation_rad[1], bias.rotation_sigma_rad[1]),
        "position_bias_up_m": (bias.position_m[2], bias.position_sigma_m[2]),
        "focal_scale": (bias.focal_scale - 1, bias.focal_scale_sigma),
        "offset_s": (clock.offset_s - GIVEN_S, clock.offset_sigma_s),
        "frame_rate": (clock.frame_rate - clock.nominal_rate, clock.frame_rate_sigma),
    }
    for name, (value, sigma) in expected.items():
        row = rows[f"uav2.{name}"]
        assert (row.value, row.sigma) == pytest.approx((value, sigma), rel=1e-9, abs=1e-15), name
        assert row.in_sigmas == pytest.approx(row.value / row.prior_sigma, rel=0.01), name
        assert row.sigma <= 1.05 * row.prior_sigma, name


def test_what_is_beyond_three_is_marked_and_graded_as_the_verdict_grades_it() -> None:
    problem = mistaken.turned(mistaken.right_flight(1), "uav2", np.array([0, 12, 0]))
    taken = solved(problem).corrections
    assert all(c.beyond == (abs(c.in_sigmas) > 3) for c in taken)
    marked = [c for c in taken if c.beyond]
    assert any(c.block == "attitude" and c.grade == "bad" for c in marked)
    assert not any(c.beyond for c in solved(mistaken.right_flight(1)).corrections)


def test_a_reason_about_a_prior_rests_on_the_figure_of_its_rows() -> None:
    noise = replace(mistaken.INSTRUMENTS, attitude_bias_rad=10 * mistaken.INSTRUMENTS.attitude_bias_rad)
    problem = mistaken.right_flight(3, noise=noise)
    for camera in problem.cameras:
        small = replace(camera.sigma, attitude_bias_rad=camera.sigma.attitude_bias_rad / 10)
        problem = mistaken.with_camera(problem, camera.camera, sigma=small)
    solution = solved(problem)
    told = [r for r in solution.verdict.reasons if r.kind == "prior-attitude"]
    assert told
    for reason in told:
        rows = [c for c in solution.corrections if c.camera == reason.subject and c.block == "attitude"]
        assert {c.chi_square for c in rows} == {reason.figure}
        assert {c.grade for c in rows} == {reason.grade}


def test_methods_without_priors_have_none() -> None:
    assert solve(mistaken.right_flight(1), SolverSettings(method="intersection")).corrections == ()
