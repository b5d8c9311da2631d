"""The bound against the solver's claims, against its own limits, and against other ways to compute the same."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.experiments.declare import Spell
from pipeline.experiments.flying.bound import BIAS, bound, camera_jacobian, camera_rows, mean_length, unknowns
from pipeline.experiments.paper.noise_levels import HIGH, LOW, with_known_clocks
from pipeline.experiments.paper.scenes import one_camera, paper_flight
from pipeline.geometry import rotation
from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.synthetic.scene import camera_pose, pixels_of
from pipeline.synthetic.simulate import simulate


@pytest.mark.parametrize("targets", [1, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_the_solver_claims_what_the_bound_says(targets, order):
    # Two independent computations: the solver eliminates frames in information form at its own estimate.
    scene = paper_flight(order=order, targets=targets)
    noise = replace(
        LOW, pixel_px=0.05, attitude_bias_rad=1e-5, attitude_rad=1e-5, position_bias_m=0.02, position_m=0.01,
        frame_rate_prior=0.01,
    )  # fmt: skip
    problem, _ = simulate(scene, noise=noise, seed=5)
    found = solve(problem, SolverSettings(robust="none"))
    limit = bound(scene, noise)
    # The plain covariance, as the bound is; `ClockSolution` tells the larger of it and the cluster-robust one.
    names = [f"{found.clocks[1].camera}.{of}" for of in ("offset_s", "frame_rate")]
    offset, rate = np.sqrt([found.shared_covariance[at, at] for at in map(found.shared_names.index, names)])
    assert offset == pytest.approx(limit.offset_sigma_s(1), rel=2e-3)
    assert rate / 10.0 == pytest.approx(limit.rate_sigma(1), rel=2e-3)
    told = found.clocks[1]
    assert told.offset_sigma_s >= 0.999999 * offset
    assert told.frame_rate_sigma >= 0.999999 * rate
    time = scene.cameras[0].frame_time_s(np.arange(0, 50, 7))
    who = limit.unknowns
    by = who.by_motion(0, time)
    part = who.motion[0]
    expected = by @ limit.covariance[part, part] @ np.swapaxes(by, 1, 2)
    np.testing.assert_allclose(found.motions[0].position_covariance(time), expected, rtol=2e-2, atol=1e-6)


def test_derivatives_agree_with_differences_of_the_projection():
    scene = paper_flight(order=2, targets=2)
    who = unknowns(scene)
    rows = camera_rows(scene, 1)
    jacobian = camera_jacobian(rows, who, 1)
    camera, frame = scene.cameras[1], np.array([11])
    point = scene.targets[1].motion.position_enu_m(camera.frame_time_s(frame))
    at, _ = pixels_of(camera, frame, point)
    step = 1e-4
    for axis in range(3):
        moved, _ = pixels_of(camera, frame, point + step * np.eye(3)[axis])
        np.testing.assert_allclose(rows.by_position[11, 1, :, axis], ((moved - at) / step)[0], rtol=1e-4, atol=1e-6)
    later = scene.targets[1].motion.position_enu_m(camera.frame_time_s(frame) + step)
    moved, _ = pixels_of(camera, frame, later)
    np.testing.assert_allclose(jacobian[11, 1, :, who.clock[1].start], ((moved - at) / step)[0], rtol=1e-3)
    centre, enu_from_cam = camera_pose(camera.platform, camera.frame_time_s(frame))
    away = point - centre
    for axis in range(3):
        turn = rotation.exp(1e-6 * np.eye(3)[[axis]])
        turned = rotation.multiply(turn, rotation.conjugate(enu_from_cam))
        y = rotation.rotate(turned, away)[0]
        pixel = camera.lens.K[:2, :2] @ (y[:2] / y[2]) + camera.lens.K[:2, 2]
        column = jacobian[11, 1, :, who.bias[1]][:, axis]
        np.testing.assert_allclose(column, (pixel - at[0]) / 1e-6, rtol=1e-3, atol=1e-2)


def test_less_noise_more_targets_and_known_clocks_lower_the_bound():
    base = bound(paper_flight(targets=2), HIGH)
    assert bound(paper_flight(targets=2), LOW).rms_m() < base.rms_m()
    assert bound(paper_flight(targets=4), HIGH).rms_m() < base.rms_m()
    known = bound(paper_flight(targets=2), with_known_clocks(HIGH))
    assert known.offset_sigma_s(1) == 0.0
    assert known.rms_m() < base.rms_m()
    hidden = (Spell(camera=0, target=0, first=10, last=50),)
    assert bound(paper_flight(targets=2), HIGH, hidden=hidden).rms_m() > base.rms_m()


def test_a_common_shift_of_the_cameras_is_a_floor_for_every_method():
    # Nothing in the images shows it: 1.73 m per axis in two cameras, 1.22 m per axis in their mean.
    perfect = replace(HIGH, pixel_px=1e-3, attitude_bias_rad=1e-9, attitude_rad=1e-9, position_m=1e-6)
    limit = bound(paper_flight(targets=4), perfect)
    assert limit.rms_m() > HIGH.position_bias_m / np.sqrt(2) * np.sqrt(3) * 0.999


@pytest.mark.parametrize(("case", "determined"), [("curved", True), ("straight", False), ("still", False)])
def test_degenerate_geometry_has_no_bound(case, determined):
    noise = replace(LOW, attitude_bias_rad=0.0, position_bias_m=0.0)
    assert bound(one_camera(kind=case), noise).determined is determined


def test_mean_length_is_that_of_drawn_vectors():
    rng = np.random.default_rng(3)
    for scale in ([1.0, 1.0, 1.0], [3.0, 0.2, 0.0], [1.0, 0.5, 0.01]):
        a = rng.normal(size=(3, 3)) * np.array(scale)
        drawn = np.linalg.norm(rng.normal(size=(100_000, 3)) @ a.T, axis=1)
        assert mean_length((a @ a.T)[None])[0] == pytest.approx(drawn.mean(), rel=0.01)
    assert mean_length(np.zeros((1, 3, 3)))[0] < 1e-100


def test_biases_have_six_places():
    assert all(part.stop - part.start == BIAS for part in unknowns(paper_flight()).bias)
