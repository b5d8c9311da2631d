"""Sightings at their rows' instants: a case worked by hand, differences, and the row's own pose spelt out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.records import SolverSettings
from pipeline.solver.adjustment.model import pose_error, residuals_of
from pipeline.solver.adjustment.renewal import renewing, rolled
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model
from pipeline.solver.observation.clocks import FOCAL, OFFSET, READOUT, SCALE
from pipeline.solver.observation.observations import metric, pack
from pipeline.solver.observation.residuals import linearise
from pipeline.solver.observation.rolling_shutter import rate_now, smallest_turn, with_rows
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

READOUT_S = 0.03


def shuttered(targets=2, seed=3, sigma_s=0.01, lens=False):
    """The paper's scene with rows, turning rates and a readout; a model, and a state away from the optimum."""
    rng = np.random.default_rng(seed)
    problem, _ = simulate(paper_scene(order=2, targets=targets), noise=PAPER_LOW, seed=seed)
    cameras = []
    for camera in problem.cameras:
        rays = replace(camera.rays, row=rng.uniform(-0.5, 0.5, len(camera.rays.frame)))
        if lens:
            rays = replace(rays, focal_effect=np.array([1.2, 0.4]) + 0.1 * rng.normal(size=(len(rays.frame), 2)))
        rate = rng.normal(size=(len(camera.poses.frame), 6)) * [0.3, 0.3, 0.3, 5.0, 5.0, 5.0]
        sigma = replace(camera.sigma, readout_s=sigma_s)
        cameras.append(replace(camera, rays=rays, pose_rate=rate, readout_s=READOUT_S, sigma=sigma))
    problem = replace(problem, cameras=tuple(cameras))
    frames = with_rows(problem, pack(problem))
    camera = first_camera(problem, {"uav2": 0.45}, {"uav2": 10.1})
    choice = first_choice(problem, "algorithm-1")
    model, state = first_model(problem, SolverSettings(), frames, choice, camera)
    camera[:, :6] = rng.normal(size=(2, 6)) * [0.01, 0.01, 0.01, 1.0, 1.0, 1.0]
    camera[:, FOCAL] = 0.02
    state = replace(
        state, coefficients=rng.normal(size=state.coefficients.shape) * 20 + [0.0, 0.0, 5.0], camera=camera,
        own=rng.normal(size=state.own.shape),
    )  # fmt: skip
    return problem, model, state


def at_its_row(problem, model, state, f, n):
    """A sighting's residual from the pose and the target's place of its row's instant, spelt out."""
    frames, c = model.frames, model.frames.camera[f]
    given = problem.cameras[c]
    row = next(
        i for i in range(len(given.rays.frame))
        if given.rays.frame[i] == frames.frame[f] and given.rays.targets[given.rays.target[i]] == frames.targets[n]
    )  # fmt: skip
    own = state.camera[c]
    dt = given.rays.row[row] * own[READOUT] * (1 + own[SCALE])
    time = frames.video_s[f] * (1 + own[SCALE]) + own[OFFSET] + dt
    turned = rotation.matrix(rotation.exp(given.pose_rate[f - frames.first[c], :3] * dt)) @ frames.cam_from_enu[f]
    place = frames.position_m[f] + given.pose_rate[f - frames.first[c], 3:] * dt
    moved = replace(
        pack(replace(problem)), cam_from_enu=np.tile(turned, (frames.count, 1, 1)),
        position_m=np.tile(place, (frames.count, 1)), angular=frames.angular,
    )  # fmt: skip
    if not frames.angular:
        moved = metric(moved)
    target = model.basis.position(np.full(frames.count, time), state.coefficients)
    error, focal = pose_error(model, state, slice(None)), np.full(frames.count, own[FOCAL])
    return linearise(moved, slice(None), target, error, focal).residual[f, n]


@pytest.mark.parametrize("lens", [False, True])
def test_a_sighting_is_seen_from_the_pose_of_its_row(lens):
    problem, model, state = shuttered(lens=lens)
    frames = rolled(model.frames, model, state)
    found = residuals_of(frames, slice(None), model, state)
    plain = residuals_of(pack(problem), slice(None), model, state)
    assert np.median(np.abs(plain - found)) > 1.0
    for f in (0, 7, frames.first[1], frames.first[1] + 11):
        for n in range(2):
            wanted = at_its_row(problem, model, state, f, n)
            np.testing.assert_allclose(found[f, n], wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


def test_metric_residuals_are_those_of_the_row():
    problem, model, state = shuttered()
    model = model.changed(frames=metric(model.frames))
    frames = rolled(model.frames, model, state)
    found = residuals_of(frames, slice(None), model, state)
    for n in range(2):
        length = np.linalg.norm(at_its_row(problem, model, state, 5, n))
        assert np.linalg.norm(found[5, n]) == pytest.approx(length, rel=1e-6)  # the plane's two axes are arbitrary


@pytest.mark.parametrize("angular", [True, False])
def test_turning_again_forgets_nothing(angular):
    """Rays are turned back before they are turned anew, however often."""
    _, model, state = shuttered()
    if not angular:
        model = model.changed(frames=metric(model.frames))
    once = rolled(model.frames, model, state)
    elsewhere = replace(state, camera=state.camera + 0.002)
    again = rolled(rolled(rolled(once, model, elsewhere), model, elsewhere), model, state)
    np.testing.assert_allclose(again.gain, once.gain, atol=1e-9 * np.abs(once.gain).max())
    np.testing.assert_allclose(again.ray, once.ray, atol=1e-12)
    np.testing.assert_allclose(again.by_readout, once.by_readout, atol=1e-9 * np.abs(once.by_readout).max())


@pytest.mark.parametrize("angular", [True, False])
def test_derivative_by_the_readout_against_differences(angular):
    _, model, state = shuttered(lens=True)
    if not angular:
        model = model.changed(frames=metric(model.frames))
    step = 1e-6
    by_readout = rolled(model.frames, model, state).by_readout

    def residuals(readout_s):
        camera = state.camera.copy()
        camera[:, READOUT] = readout_s
        there = replace(state, camera=camera)
        return residuals_of(rolled(model.frames, model, there), slice(None), model, there)

    numerical = (residuals(READOUT_S + step) - residuals(READOUT_S - step)) / (2 * step)
    np.testing.assert_allclose(by_readout, numerical, atol=1e-6 * np.abs(numerical).max())


def test_a_case_worked_by_hand():
    """A camera that looks ahead and turns to the right by 0.5 rad/s; a still point on its axis, in the last row.

    10 ms after the middle row the camera has turned by 5 mrad, so that the point lies 5 mrad to the left.
    """
    problem, model, state = shuttered(targets=1)
    c, f, dt = 0, 0, 0.01
    camera = problem.cameras[c]
    rate = np.zeros((len(camera.poses.frame), 6))
    rate[:, 1] = -0.5  # the map turns to the left, about the axis that points down
    rays = replace(
        camera.rays, row=np.full(len(camera.rays.frame), 0.5), direction_cam=np.tile([0.0, 0, 1], (len(rate), 1)),
        pixel_from_ray=np.tile([[1000.0, 0, 0], [0, 1000.0, 0]], (len(rate), 1, 1)), sigma_px=np.ones(len(rate)),
    )  # fmt: skip
    still = replace(camera, rays=rays, pose_rate=rate, readout_s=2 * dt)
    problem = replace(problem, cameras=(still, *problem.cameras[1:]))
    frames = with_rows(problem, pack(problem))
    ahead = frames.position_m[f] + 50 * frames.cam_from_enu[f, 2]
    state = replace(state, camera=np.zeros_like(state.camera), own=np.zeros_like(state.own))
    state.camera[c, READOUT] = 2 * dt
    coefficients = np.zeros_like(state.coefficients)
    coefficients[0] = ahead
    state = replace(state, coefficients=coefficients)
    found = residuals_of(rolled(frames, model, state), slice(None), model, state)
    np.testing.assert_allclose(found[f, 0], [-1000 * np.tan(0.005), 0.0], atol=1e-6)


def test_without_a_readout_nothing_is_renewed():
    problem, _ = simulate(paper_scene(), noise=PAPER_LOW, seed=0)
    frames = pack(problem)
    assert renewing(problem) is None
    assert with_rows(problem, frames) is frames
    rows = [replace(c, rays=replace(c.rays, row=np.zeros(len(c.rays.frame)))) for c in problem.cameras]
    assert with_rows(replace(problem, cameras=tuple(rows)), frames) is frames


def test_rates_follow_log_times_that_move():
    _, model, _ = shuttered()
    frames = model.frames
    assert rate_now(frames, frames.rows) is frames.rows.rate
    part = frames.of(1)
    step = float(np.diff(frames.video_s[part])[0])
    moved = replace(frames, pose_shift_s=np.full(frames.count, step))
    np.testing.assert_allclose(rate_now(moved, frames.rows)[part][:-1], frames.rows.rate[part][1:], atol=1e-9)


def test_smallest_turn_takes_one_direction_to_the_other():
    rng = np.random.default_rng(0)
    before, after = rng.normal(size=(2, 50, 3)) + np.array([0, 0, 3.0])
    turn = smallest_turn(before, after)
    unit = (turn @ (before / np.linalg.norm(before, axis=1)[:, None])[..., None])[..., 0]
    np.testing.assert_allclose(unit, after / np.linalg.norm(after, axis=1)[:, None], atol=1e-12)
    np.testing.assert_allclose(turn @ np.swapaxes(turn, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(smallest_turn(np.zeros((1, 3)), after[:1])[0], np.eye(3))
