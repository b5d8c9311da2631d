"""Small flights with one mistake each, made of problems that were right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.camera import pixel_from_ray
from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import CameraInput, Problem
from pipeline.synthetic.scenes import paper_scene, plain_lens
from pipeline.synthetic.simulate import Noise, simulate

INSTRUMENTS = Noise(
    pixel_px=1.0, attitude_bias_rad=np.radians(0.3), attitude_rad=np.radians(0.2), position_bias_m=1.0,
    position_m=0.3, offset_s=0.02,
)  # fmt: skip


def right_flight(seed: int, targets: int = 4, noise: Noise = INSTRUMENTS) -> Problem:
    """Two cameras, targets of order 1, offsets known to 20 ms, every claim true."""
    return simulate(paper_scene(order=1, targets=targets, given_offset_s=0.5), noise=noise, seed=seed)[0]


def with_camera(problem: Problem, name: str, **values: object) -> Problem:
    """The problem with other values of one camera."""
    cameras = tuple(replace(c, **values) if c.camera == name else c for c in problem.cameras)  # type: ignore[arg-type]
    return replace(problem, cameras=cameras)


def camera_of(problem: Problem, name: str) -> CameraInput:
    """One camera of a problem."""
    return next(c for c in problem.cameras if c.camera == name)


def turned(problem: Problem, name: str, turn_deg: Floats) -> Problem:
    """One camera's attitudes turned by a rotation vector in camera axes."""
    poses = camera_of(problem, name).poses
    turn = rotation.exp(np.radians(np.asarray(turn_deg, float)))
    return with_camera(problem, name, poses=replace(poses, enu_from_cam=rotation.multiply(poses.enu_from_cam, turn)))


def shifted(problem: Problem, name: str, shift_m: Floats, since: int = 0) -> Problem:
    """One camera's positions shifted, from a frame on."""
    poses = camera_of(problem, name).poses
    moved = poses.position_enu_m + np.where((poses.frame >= since)[:, None], shift_m, 0.0)
    return with_camera(problem, name, poses=replace(poses, position_enu_m=moved))


def exchanged(problem: Problem, name: str, a: int, b: int, since: int = 0) -> Problem:
    """Two targets' names exchanged in one camera, from a frame on."""
    rays = camera_of(problem, name).rays
    swap = np.arange(len(rays.targets))
    swap[[a, b]] = b, a
    target = np.where(rays.frame >= since, swap[rays.target], rays.target)
    order = np.lexsort((target, rays.frame))
    return with_camera(problem, name, rays=replace(rays, target=target).some(order))


def sliding(problem: Problem, name: str, target: int, since: int, px_per_frame: float = 3.0) -> Problem:
    """One track that runs away sideways from a frame on."""
    rays = camera_of(problem, name).rays
    away = np.where(rays.target == target, np.maximum(rays.frame - since, 0), 0) * px_per_frame
    across = rays.pixel_from_ray[:, 0] / (rays.pixel_from_ray[:, 0] ** 2).sum(axis=1, keepdims=True)
    direction = rays.direction_cam + across * away[:, None]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moved = replace(rays, direction_cam=direction, pixel_from_ray=pixel_from_ray(plain_lens(), direction))
    return with_camera(problem, name, rays=moved)
