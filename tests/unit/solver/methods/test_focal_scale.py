"""Focal lengths that are wrong by 2 %, of lenses that distort: found, and the motion with them, within the claims."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.camera import CameraModel, focal_effect, pixel_from_ray, project, unproject
from pipeline.records import SolverSettings
from pipeline.solver import solve
from tests.scenes.solver import looped_flight

TRUE = (0.98, 1.01, 0.99)
BARREL = np.array([-0.26, 0.075, 0.0, 0.0, -0.009])
TIMES = np.arange(5.0, 55.0, 0.5)


def lens(scale: float) -> CameraModel:
    K = np.array([[1000.0 * scale, 0, 960], [0, 1000.0 * scale, 540], [0, 0, 1]])
    return CameraModel(image_size=(1920, 1080), K=K, distortion=BARREL)


def flight(seed: int, aware: bool):
    """Three cameras whose rays are unprojected with focal lengths other than the true ones."""
    problem, path = looped_flight(0.0, seed=seed, seconds=60.0, wide=1.6)
    cameras = []
    for camera, scale in zip(problem.cameras, TRUE, strict=True):
        rays, poses = camera.rays, camera.poses
        pixel = project(lens(scale), rays.direction_cam)
        ray = unproject(lens(1.0), pixel)
        keep = np.isfinite(ray).all(axis=1) & (np.abs(pixel - [960, 540]) < [960, 540]).all(axis=1)
        changed = replace(
            rays, **{name: getattr(rays, name)[keep] for name in ("target", "frame", "time_s", "sigma_px")},
            direction_cam=ray[keep], pixel_from_ray=pixel_from_ray(lens(1.0), ray[keep]),
            focal_effect=focal_effect(lens(1.0), ray[keep]) if aware else None,
        )  # fmt: skip
        poses = replace(
            poses, **{n: getattr(poses, n)[keep] for n in ("frame", "time_s", "position_enu_m", "enu_from_cam")}
        )
        cameras.append(
            replace(camera, rays=changed, poses=poses, clock="affine", sigma=replace(camera.sigma, focal=0.02))
        )
    return replace(problem, cameras=tuple(cameras)), path


def ratios(seed: int, aware: bool):
    """Errors of the focal scales over their sigmas, and RMSE of the positions in metres."""
    problem, path = flight(seed, aware)
    found = solve(problem, SolverSettings())
    scales = [(b.focal_scale - true) / b.focal_scale_sigma for b, true in zip(found.biases, TRUE, strict=True)]
    error = found.motions[0].position_enu_m(TIMES) - path(TIMES)
    return np.array(scales), float(np.sqrt((error**2).sum(axis=1).mean()))


def test_they_are_found_within_their_sigmas():
    """And the motion better than where the same lenses are taken for plain: there its errors are twice as large."""
    aware = [ratios(seed, True) for seed in range(6)]
    errors = np.array([scales for scales, _ in aware])
    assert 0.6 < np.sqrt((errors**2).mean()) < 1.4
    assert np.abs(errors).max() < 4
    unaware = [ratios(seed, False)[1] for seed in range(6)]
    assert np.sum(np.square(unaware)) > 2 * np.sum(np.square([rmse_m for _, rmse_m in aware]))


def test_a_lens_that_says_it_is_plain_is_plain():
    problem, _ = flight(0, False)
    told = [
        replace(c, rays=replace(c.rays, focal_effect=np.tile([1.0, 0.0], (len(c.rays.frame), 1))))
        for c in problem.cameras
    ]
    one, other = solve(problem, SolverSettings()), solve(replace(problem, cameras=tuple(told)), SolverSettings())
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    np.testing.assert_allclose(one.motions[0].coefficients, other.motions[0].coefficients, atol=1e-4)
