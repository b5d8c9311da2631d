"""Cameras that follow targets, and strangers, with clocks that know nothing of each other."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import rotation
from pipeline.records import CameraInput, InstrumentSigma, PoseTrack, SightRays

SIGMA = InstrumentSigma(
    attitude_bias_rad=float(np.radians(0.5)), attitude_rad=float(np.radians(0.1)), position_bias_m=1.0, position_m=0.2,
    frame_rate=0.001,
)  # fmt: skip
FOCAL_PX, RATE_HZ, SECONDS = 1000.0, 5.0, 24.0


def paths(seed: int, count: int, ground_m: float = 12.0) -> list:
    """Cars on curved ways within some 60 m: functions of time (n,) -> (n, 3)."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        place, heading, speed = rng.uniform(-50, 50, 2), rng.uniform(0, 6.28), rng.uniform(4, 10)
        turn, wave = rng.uniform(-0.15, 0.15), rng.uniform(0.2, 0.5)

        def at(t, place=place, heading=heading, speed=speed, turn=turn, wave=wave):
            fine = np.linspace(-30, 60, 1801)
            v = speed * (1 + 0.5 * np.sin(wave * fine + 9 * heading))
            way = np.stack([v * np.sin(heading + turn * fine), v * np.cos(heading + turn * fine)], 1) * 0.05
            xy = np.cumsum(way, 0) - np.cumsum(way, 0)[840] + place
            return np.column_stack([*(np.interp(t, fine, xy[:, k]) for k in (0, 1)), np.full(len(t), ground_m)])

        found.append(at)
    return found


def parked(seed: int, count: int, ground_m: float = 12.0) -> list:
    """Cars that stand, some 15 m from each other."""
    rng = np.random.default_rng(seed)
    spots = [15.0 * np.array([k % 4, k // 4]) + rng.uniform(-3, 3, 2) for k in range(count)]
    return [lambda t, p=p: np.tile([*p, ground_m], (len(t), 1)) for p in spots]


def camera(name: str, followed: dict, *, begin_s: float, bearing_rad: float, seed: int) -> CameraInput:
    """A camera that flies around the scene, looks at it, and follows `followed` by their names there."""
    rng = np.random.default_rng([seed, 7])
    t = begin_s + np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    angle = bearing_rad + 0.03 * t
    position = np.column_stack([170 * np.sin(angle), 170 * np.cos(angle), 90 + 0 * t])
    ahead = -position + [0, 0, 12.0]
    yaw, pitch = np.arctan2(ahead[:, 0], ahead[:, 1]), np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))
    attitude = rotation.enu_from_cam(rotation.ned_from_frd(yaw, pitch, 0 * t))
    told = rotation.multiply(
        attitude,
        rotation.exp(rng.normal(0, SIGMA.attitude_bias_rad, 3) + rng.normal(0, SIGMA.attitude_rad, (len(t), 3))),
    )
    where = position + rng.normal(0, SIGMA.position_bias_m, 3) + rng.normal(0, SIGMA.position_m, position.shape)
    rays = []
    for path in followed.values():
        y = rotation.rotate(rotation.conjugate(attitude), path(t) - position)
        flat = y[:, :2] / y[:, 2:] + rng.normal(0, 1 / FOCAL_PX, (len(t), 2))
        ray = np.column_stack([flat, np.ones(len(t))])
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
    k, n = len(rays), len(t)
    ray = np.stack(rays, 1).reshape(-1, 3)
    x, y, z = ray.T
    zero = np.zeros(len(ray))
    jacobian = FOCAL_PX * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], 1)
    frame = np.repeat(np.arange(n), k)
    return CameraInput(
        camera=name,
        rays=SightRays(
            camera=name, targets=tuple(followed), target=np.tile(np.arange(k), n), frame=frame,
            time_s=frame / RATE_HZ, direction_cam=ray, pixel_from_ray=jacobian, sigma_px=np.ones(len(ray)),
        ),
        poses=PoseTrack(
            camera=name, frame=np.arange(n), time_s=np.arange(n) / RATE_HZ, position_enu_m=where, enu_from_cam=told
        ),
        frame_rate=RATE_HZ,
        sigma=SIGMA,
    )  # fmt: skip


def scene(seed: int, cameras: int = 2, common: int = 4, strangers: int = 2) -> tuple[list[CameraInput], dict]:
    """Cameras that follow `common` cars and each some of its own, and by camera: name of a track -> number of a car."""
    rng = np.random.default_rng([seed, 1])
    cars = paths(seed, common + cameras * strangers)
    found, truth = [], {}
    for c in range(cameras):
        mine = [*range(common), *range(common + c * strangers, common + (c + 1) * strangers)]
        mine = [mine[k] for k in rng.permutation(len(mine))]
        name = f"uav{c + 1}"
        truth[name] = {f"t{k}": car for k, car in enumerate(mine)}
        begin = 0.0 if c == 0 else float(rng.uniform(-6, 6))
        followed = {track: cars[car] for track, car in truth[name].items()}
        found.append(camera(name, followed, begin_s=begin, bearing_rad=1.3 * c, seed=seed * 10 + c))
        truth[name, "begin_s"] = begin
    return found, truth
