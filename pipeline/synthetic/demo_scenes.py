"""The flights that are rendered: two UAVs on curved paths watch four vehicles on country roads.

UAV 1 carries its camera on a gimbal and wanders along an arc; UAV 2 carries it fixed and turns its body. Vehicle paths
are polynomials of order 1 or 2 in common time, with the roads drawn under them; a bridge hides one of the vehicles
from each camera for about a second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.camera import CameraModel
from calibration.foundation.arrays import Floats
from pipeline.synthetic.scene import (
    Bridge,
    Landscape,
    Path,
    Platform,
    Road,
    Scene,
    SceneCamera,
    SceneTarget,
    VehicleShape,
    look_at,
    polynomial_motion,
)
from pipeline.synthetic.scenes import ORIGIN

OFFSET_S = 1.6137
MARGIN_S = 6.0
MOUNT_DEG = (3.0, -38.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """What differs between the demo and the small flight of `data/`."""

    name: str
    size: tuple[int, int]
    focal_px: float
    seconds: float
    nearness: float
    crowding: float
    bridge_after_s: float
    half_size_m: float
    texel_m: float


def demo_scene(seed: int = 7) -> Scene:
    """Two UAVs, 20 s, 1280 x 720, about 300 m away. Camera 2 is said to run at 25 Hz and truly runs at 25.02."""
    return _scene(
        _Plan(
            name="demo",
            size=(1280, 720),
            focal_px=1300.0,
            seconds=20.0,
            nearness=1.0,
            crowding=1.0,
            bridge_after_s=2.0,
            half_size_m=540.0,
            texel_m=0.3,
        ),
        seed,
    )


def small_scene(seed: int = 11) -> Scene:
    """The flight of `data/`: the same country, 8 s, 640 x 360, about 170 m away."""
    return _scene(
        _Plan(
            name="small",
            size=(640, 360),
            focal_px=650.0,
            seconds=8.0,
            nearness=0.6,
            crowding=0.8,
            bridge_after_s=-1.2,
            half_size_m=320.0,
            texel_m=0.25,
        ),
        seed,
    )


def _scene(plan: _Plan, seed: int) -> Scene:
    rng = np.random.default_rng([seed, 1])
    span = (-MARGIN_S, plan.seconds + OFFSET_S + MARGIN_S)
    middle_s = (plan.seconds + OFFSET_S) / 2
    targets = _vehicles(plan.crowding, middle_s, span)
    frames = round(25.0 * plan.seconds)
    cameras = (
        SceneCamera(
            name="uav1",
            lens=demo_lens(plan.size, plan.focal_px, unit=0),
            platform=_gimbal_platform(plan, span, rng),
            frame_rate=25.0,
            nominal_rate=25.0,
            offset_s=0.0,
            frames=frames,
        ),
        SceneCamera(
            name="uav2",
            lens=demo_lens(plan.size, plan.focal_px, unit=1),
            platform=_fixed_platform(plan, span, rng),
            frame_rate=25.02,
            nominal_rate=25.0,
            offset_s=OFFSET_S,
            frames=frames,
        ),
    )
    return Scene(
        name=plan.name,
        cameras=cameras,
        targets=targets,
        origin=ORIGIN,
        landscape=_landscape(plan, targets, middle_s, seed),
    )


def demo_lens(size: tuple[int, int], focal_px: float, unit: int = 0) -> CameraModel:
    """A lens with some barrel distortion, its principal point off the middle; units of one make differ a little."""
    width, height = size
    scale, right, down, bend = ((1.0018, 0.0018, -0.0032, -0.12), (0.9967, -0.0024, 0.0021, -0.113))[unit]
    K = np.array(
        [
            [focal_px * scale, 0.0, (width - 1) / 2 + right * width],
            [0.0, focal_px * (scale - 0.001), (height - 1) / 2 + down * height],
            [0.0, 0.0, 1.0],
        ]
    )
    return CameraModel(image_size=size, K=K, distortion=np.array([bend, 0.06, 0.0006, -0.0004, 0.0]))


# Vehicles: place and velocity (m, m/s) at the middle of the flight, acceleration (m/s^2), all east and north. Roofs
# with hardly a wall under them: the truth names one point, and what a tracker sees of roof, walls and shadow together
# wanders as the view turns.
_SHAPES = {
    "car": VehicleShape(length_m=4.7, width_m=2.1, roof_m=1.4, skirt_m=0.15, colour=(40, 45, 190), seed=1),
    "truck": VehicleShape(length_m=8.0, width_m=2.6, roof_m=2.2, skirt_m=0.15, colour=(60, 175, 225), seed=2),
    "van": VehicleShape(length_m=6.2, width_m=2.4, roof_m=1.8, skirt_m=0.15, colour=(150, 60, 150), seed=3),
    "pickup": VehicleShape(length_m=5.5, width_m=2.2, roof_m=1.5, skirt_m=0.15, colour=(165, 120, 40), seed=4),
}
_MOVES = {
    "car": ((-4.0, -32.0), (8.4, 1.49), (0.0, 0.0)),
    "truck": ((12.0, -22.3), (-6.9, -1.22), (0.22, 0.039)),
    "van": ((36.0, 24.0), (-1.6, 7.3), (-0.34, 0.05)),
    "pickup": ((-50.0, 30.0), (5.4, 3.4), (0.12, 0.36)),
}
ORDERS = {"car": 1, "truck": 2, "van": 2, "pickup": 2}


def _vehicles(crowding: float, middle_s: float, span: tuple[float, float]) -> tuple[SceneTarget, ...]:
    made = []
    for name, (place, velocity, acceleration) in _MOVES.items():
        x, v, a = crowding * np.array(place), np.array(velocity), np.array(acceleration)
        flat = np.array([x - v * middle_s + a * middle_s**2 / 2, v - a * middle_s, a / 2])[: ORDERS[name] + 1]
        shape = _SHAPES[name]
        up = np.zeros((len(flat), 1))
        up[0] = shape.roof_m
        motion = polynomial_motion(name, np.hstack([flat, up]), span)
        made.append(SceneTarget(name=name, motion=motion, shape=shape))
    return tuple(made)


def _landscape(plan: _Plan, targets: tuple[SceneTarget, ...], middle_s: float, seed: int) -> Landscape:
    by_name = {t.name: t for t in targets}
    at = np.array([middle_s + plan.bridge_after_s])
    over = by_name["van"].motion.position_enu_m(at)[0]
    velocity = by_name["van"].motion.position_enu_m(at, 1)[0]
    heading = float(np.arctan2(velocity[0], velocity[1]) + np.pi / 2)
    along = np.array([np.sin(heading), np.cos(heading)])
    bridge = Bridge(centre_enu_m=(over[0], over[1], 6.0), heading_rad=heading, length_m=34.0, width_m=10.0)
    reach = 2.0 * plan.half_size_m
    main = plan.crowding * np.array([_MOVES["car"][0], _MOVES["truck"][0]]).mean(axis=0)
    way = np.array(_MOVES["car"][1]) / np.linalg.norm(_MOVES["car"][1])
    ramp = bridge.length_m / 2 + 38.0
    roads = (
        Road(line_m=main + np.array([[-reach], [reach]]) * way, width_m=13.0),
        Road(line_m=_bend(by_name["van"], middle_s), width_m=8.0),
        Road(line_m=_bend(by_name["pickup"], middle_s), width_m=8.0),
        Road(line_m=over[:2] + np.array([[ramp], [reach]]) * along, width_m=9.0),
        Road(line_m=over[:2] - np.array([[ramp], [reach]]) * along, width_m=9.0),
    )
    return Landscape(half_size_m=plan.half_size_m, texel_m=plan.texel_m, seed=seed, roads=roads, bridge=bridge)


def _bend(target: SceneTarget, middle_s: float) -> Floats:
    """The vehicle's own path, going on straight after 14 s on either side."""
    time = np.linspace(middle_s - 14.0, middle_s + 14.0, 57)
    line = target.motion.position_enu_m(time)[:, :2]
    speed = target.motion.position_enu_m(time, 1)[:, :2]
    return np.asarray(np.concatenate([[line[0] - 60 * speed[0]], line, [line[-1] + 60 * speed[-1]]]))


def _gimbal_platform(plan: _Plan, span: tuple[float, float], rng: np.random.Generator) -> Platform:
    """South-west of the vehicles, flying east along an arc; the body points where it flies."""
    time = np.arange(span[0], span[1], 0.1)
    middle = sum(span) / 2
    azimuth = np.radians(197.0) - np.radians(1.5 / plan.nearness) * (time - middle)
    flat = plan.nearness * (222.0 + 9.0 * np.sin(0.35 * (time - middle)))
    up = plan.nearness * 196.0 + 2.5 * np.sin(0.31 * time + 0.4)
    position = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up], axis=1)
    velocity = np.gradient(position, time, axis=0)
    course = np.unwrap(np.arctan2(velocity[:, 0], velocity[:, 1]))
    body = np.stack([course, np.full_like(time, np.radians(-4.0)), np.full_like(time, np.radians(-3.0))], axis=1)
    aim = np.array([0.0, 2.0, 0.0]) + np.stack([6 * np.sin(0.3 * time), 4 * np.cos(0.23 * time), 0 * time], axis=1)
    yaw, pitch = look_at(position, aim)
    gimbal = np.stack([yaw, pitch, np.zeros_like(time)], axis=1)
    return Platform(
        position_enu_m=Path(time_s=time, value=position),
        yaw_pitch_roll_rad=Path(time_s=time, value=body + _sway(time, np.radians([1.0, 1.2, 1.6]), rng)),
        gimbal_rad=Path(time_s=time, value=gimbal + _sway(time, np.radians([0.12, 0.10, 0.15]), rng)),
        lever_arm_m=(0.12, 0.0, 0.10),
    )


def _fixed_platform(plan: _Plan, span: tuple[float, float], rng: np.random.Generator) -> Platform:
    """South-east to north-east of the vehicles, sliding sideways; the body itself turns the camera."""
    time = np.arange(span[0], span[1], 0.1)
    middle = sum(span) / 2
    azimuth = np.radians(114.0) - np.radians(1.3 / plan.nearness) * (time - middle)
    flat = plan.nearness * (236.0 + 7.0 * np.cos(0.3 * (time - middle)))
    up = plan.nearness * 184.0 + 3.0 * np.sin(0.27 * time)
    position = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up], axis=1)
    yaw, pitch = look_at(position, np.array([0.0, 4.0, 0.0]))
    mount_yaw, mount_pitch, mount_roll = np.radians(MOUNT_DEG)
    body = np.stack([yaw - mount_yaw, pitch - mount_pitch, np.full_like(time, -mount_roll)], axis=1)
    return Platform(
        position_enu_m=Path(time_s=time, value=position),
        yaw_pitch_roll_rad=Path(time_s=time, value=body + _sway(time, np.radians([0.5, 0.5, 0.7]), rng)),
        mount_rad=(float(mount_yaw), float(mount_pitch), float(mount_roll)),
        lever_arm_m=(0.18, -0.03, 0.07),
    )


def _sway(time: Floats, size_rad: Floats, rng: np.random.Generator) -> Floats:
    """Wind and control: slow sinusoids (n, 3) with peaks near `size_rad` (3,)."""
    rate_hz = np.array([0.17, 0.31, 0.53])
    share = np.array([0.55, 0.3, 0.15])
    phase = rng.uniform(0, 2 * np.pi, size=(3, 3))
    waves = np.sin(2 * np.pi * rate_hz[:, None] * time[:, None, None] + phase)
    return np.asarray(np.einsum("nrk,r->nk", waves, share) * size_rad)
