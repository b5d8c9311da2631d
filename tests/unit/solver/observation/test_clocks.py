"""Clocks: affine, drifting, and the log times they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, common_time_s, drift_knots
from pipeline.solver.observation.observations import pack
from pipeline.synthetic.scene import camera_pose
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import Noise, simulate
from tests.scenes.solver import looped_flight

LATE_S = 0.15
QUIET = Noise(
    pixel_px=0.3,
    attitude_bias_rad=1e-4,
    attitude_rad=1e-4,
    position_bias_m=0.05,
    position_m=0.02,
    frame_rate_prior=0.05,
)


def test_common_time_is_the_record_s():
    """The solver's clock and `Clock.common_time_s` are one formula, drift included."""
    problem, _ = simulate(paper_scene(), noise=QUIET, seed=0)
    frames = pack(problem)
    drift = drift_knots(frames, {1: 1.0})
    camera, deviation = np.zeros((2, CAMERA_PARAMETERS)), 0.02 * np.random.default_rng(0).normal(size=drift.count)
    camera[1, 7:9] = 0.4, 0.01
    from pipeline.records import Clock

    clock = Clock(
        camera="uav2", offset_s=0.4, frame_rate=10 / 1.01, nominal_rate=10.0, offset_sigma_s=0.0, frame_rate_sigma=0.0,
        deviation_frame=drift.knot_s * 10.0, deviation_s=deviation,
    )  # fmt: skip
    own = frames.of(1)
    np.testing.assert_allclose(
        common_time_s(frames, drift, camera, deviation)[own], clock.common_time_s(frames.video_s[own]), atol=1e-12
    )


def moved_log(problem, scene, late_s):
    """The second camera's poses come from a log whose time of frame 0 is given `late_s` too late."""
    camera, true = problem.cameras[1], scene.cameras[1]
    asked: list[float] = []

    def poses_at(shift_s):
        time = true.frame_time_s(camera.poses.frame) + late_s + shift_s
        asked.append(float(np.mean(shift_s)))
        place, turn = camera_pose(true.platform, time)
        return replace(camera.poses, position_enu_m=place, enu_from_cam=turn)

    changed = replace(
        camera,
        poses=poses_at(np.zeros(len(camera.poses.frame))),
        poses_at=poses_at,
        sigma=replace(camera.sigma, start_s=0.5),
    )
    return replace(problem, cameras=(problem.cameras[0], changed)), asked


def test_the_start_of_the_log_is_found():
    scene = paper_scene(order=1, targets=4, offset_frames=2)
    problem, _ = simulate(scene, noise=QUIET, seed=2)
    late, asked = moved_log(problem, scene, LATE_S)
    solution = solve(late, SolverSettings(robust="none"))
    assert solution.status == "converged"
    bias = next(b for b in solution.biases if b.camera == "uav2")
    assert bias.start_s == pytest.approx(-LATE_S, abs=4 * bias.start_sigma_s)
    assert bias.start_sigma_s < 0.03
    assert max(np.abs(asked)) > 0.1
    held = replace(late.cameras[1], sigma=replace(late.cameras[1].sigma, start_s=0.0))
    stuck = solve(replace(late, cameras=(late.cameras[0], held)), SolverSettings(robust="none"))
    assert stuck.cost > solution.cost


def test_a_log_that_ends_too_early_is_carried_on():
    """Beyond the log's end poses go on as fast as they moved, instead of an error in the middle of the descent."""
    from calibration.foundation.errors import InputFileError

    scene = paper_scene(order=1, targets=4, offset_frames=2)
    problem, _ = simulate(scene, noise=QUIET, seed=2)
    late, _ = moved_log(problem, scene, LATE_S)
    camera = late.cameras[1]

    def refusing(shift_s):
        if np.min(shift_s) < -0.05:
            raise InputFileError(where="log", seen="its end", expected="more", advice="none")
        return camera.poses_at(shift_s)

    solution = solve(
        replace(late, cameras=(late.cameras[0], replace(camera, poses_at=refusing))), SolverSettings(robust="none")
    )
    assert solution.biases[1].start_s == pytest.approx(-LATE_S, abs=0.05)


def test_a_wobbling_clock_is_noticed_and_followed():
    problem, path = looped_flight(0.05)
    solution = solve(problem, SolverSettings())
    assert solution.status == "converged"
    kinds = {f.subject: f.kind for f in solution.findings if f.kind.startswith("clock-")}
    assert kinds == {"cam1": "clock-affine", "cam2": "clock-drifts"}
    clock = solution.clock("cam2")
    tau = np.arange(5.0, 145.0, 1.0)
    true = tau + 0.1 + 0.05 * np.sin(2 * np.pi * (tau + 0.1) / 75.0)
    assert np.sqrt(np.mean((clock.common_time_s(tau) - true) ** 2)) < 0.006
    assert (clock.deviation_sigma_s > 0).all()
    time = np.arange(5.0, 145.0, 0.5)
    motion = solution.motions[0]
    error = np.linalg.norm(motion.position_enu_m(time) - path(time), axis=1)
    sigma = np.sqrt(np.trace(motion.position_covariance(time), axis1=1, axis2=2))
    assert np.sqrt((error**2).mean()) < 0.15
    assert 0.5 < np.sqrt((error**2).mean() / (sigma**2).mean()) < 1.5


def test_steady_clocks_stay_affine():
    problem, _ = looped_flight(0.0)
    solution = solve(problem, SolverSettings())
    assert [f.kind for f in solution.findings if f.subject in ("cam1", "cam2")] == ["clock-affine", "clock-affine"]
    assert all(c.deviation_s is None for c in solution.clocks)


def test_sigma_grows_in_a_gap():
    problem, path = looped_flight(0.0)
    cameras = []
    for camera in problem.cameras:
        rays = camera.rays
        keep = (rays.time_s < 60.0) | (rays.time_s > 68.0)
        fields = ("target", "frame", "time_s", "direction_cam", "pixel_from_ray", "sigma_px")
        rays = replace(rays, **{f: getattr(rays, f)[keep] for f in fields})
        poses = camera.poses
        poses = replace(
            poses, **{f: getattr(poses, f)[keep] for f in ("frame", "time_s", "position_enu_m", "enu_from_cam")}
        )
        cameras.append(replace(camera, rays=rays, poses=poses, clock="affine"))
    solution = solve(replace(problem, cameras=tuple(cameras)), SolverSettings())
    motion = solution.motions[0]
    sigma = np.sqrt(np.trace(motion.position_covariance(np.array([50.0, 64.0])), axis1=1, axis2=2))
    assert sigma[1] > 20 * sigma[0]
    gap = np.linspace(60.5, 67.5, 15)
    error = np.linalg.norm(motion.position_enu_m(gap) - path(gap), axis=1)
    claimed = np.sqrt(np.trace(motion.position_covariance(gap), axis1=1, axis2=2))
    assert (error < 4 * claimed).all()
