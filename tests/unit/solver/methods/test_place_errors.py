"""Tracked points that sit elsewhere on their targets than the other camera sees them."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import pixel_from_ray
from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS
from pipeline.solver.observation.observations import pack
from pipeline.synthetic.scenes import paper_scene, plain_lens
from pipeline.synthetic.simulate import PAPER_LOW, simulate

PLACE = (2.0, 1.0)


def flight(seed, shift_px=0.0):
    """Two cameras; the second sees the first target `shift_px` to the right of where it is."""
    noise = replace(PAPER_LOW, pixel_px=0.1)
    problem, truth = simulate(paper_scene(order=1, targets=3, given_offset_s=0.4), noise=noise, seed=seed)
    cameras = []
    for index, camera in enumerate(problem.cameras):
        rays = camera.rays
        if index == 1:
            flat = rays.direction_cam / rays.direction_cam[:, 2:]
            flat[rays.target == 0, 0] += shift_px / plain_lens().K[0, 0]
            unit = flat / np.linalg.norm(flat, axis=1, keepdims=True)
            rays = replace(rays, direction_cam=unit, pixel_from_ray=pixel_from_ray(plain_lens(), unit))
        cameras.append(replace(camera, rays=replace(rays, place_sigma_px=PLACE)))
    return replace(problem, cameras=tuple(cameras)), truth


def test_the_gradient_is_that_of_the_cost():
    problem, _ = flight(1, 3.0)
    frames = pack(problem)
    settings = SolverSettings(robust="none")
    model, state = first_model(
        problem, settings, frames, first_choice(problem), first_camera(problem, {"uav2": 0.5}, {})
    )
    rng = np.random.default_rng(2)
    coefficients = state.coefficients + rng.normal(0, 5, state.coefficients.shape) + [0, 0, 5]
    camera = state.camera.copy()
    camera[:, CAMERA_PARAMETERS:] = rng.normal(0, 1, camera[:, CAMERA_PARAMETERS:].shape)
    state = replace(state, coefficients=coefficients, camera=camera)
    model = replace(model, pose=replace(model.pose, spread=np.zeros_like(model.pose.spread)))
    here = linear(model, state)
    for c, place in ((0, 0), (0, 3), (1, 1), (1, 2), (1, 11)):
        k = CAMERA_PARAMETERS + place
        step = np.zeros_like(camera)
        step[c, k] = 1e-4
        ahead, behind = (linear(model, replace(state, camera=camera + s)).cost for s in (step, -step))
        assert here.system.gradient[model.order.camera[c, k]] == pytest.approx(
            (ahead - behind) / 2e-4, rel=1e-5, abs=1e-3
        )


def test_a_displaced_point_is_found_and_named():
    solution = solve(flight(3, 8.0)[0], SolverSettings())
    plain = solve(flight(3, 0.0)[0], SolverSettings())
    assert "uav2.target1.place_x_px" in solution.shared_names
    assert solution.chi_square < 1.3 * plain.chi_square + 20


def test_the_claimed_sigmas_hold_where_points_are_displaced():
    """Squared error of the first target's middle over its covariance, over draws of the displacement."""
    squares = []
    for seed in range(24):
        problem, truth = flight(seed, float(np.random.default_rng(seed).normal(0, PLACE[0])))
        motion = solve(problem, SolverSettings()).motion("target1")
        true = next(t for t in truth.trajectories if t.target == "target1")
        middle = len(true.time_s) // 2
        time = true.time_s[middle : middle + 1]
        error = motion.position_enu_m(time)[0] - true.position_enu_m[middle]
        squares.append(error @ np.linalg.solve(motion.position_covariance(time)[0], error) / 3)
    assert 0.6 < np.mean(squares) < 1.5
