"""Named scenes: the paper's simulated flights."""

from __future__ import annotations

import numpy as np

from calibration.camera import CameraModel
from calibration.foundation.arrays import Floats
from pipeline.geometry.geodesy import Geodetic
from pipeline.synthetic.scene import Path, Platform, Scene, SceneCamera, SceneTarget, look_at, polynomial_motion

ORIGIN = Geodetic.from_degrees(28.2, 112.9, 60.0)

_PAPER_PLACE = np.array([[-25.0, -15.0, 5.0], [20.0, -25.0, 15.0], [15.0, 25.0, 0.0], [-20.0, 20.0, 20.0]])
_PAPER_VELOCITY = np.array([[11.0, 6.0, 0.5], [-7.0, 9.0, -1.0], [-8.0, -10.0, 1.0], [9.0, -8.0, 0.0]])
_PAPER_ACCELERATION = np.array([[-1.0, 1.6, 0.1], [1.5, 0.8, 0.2], [0.6, 1.8, -0.2], [-1.8, -0.4, 0.1]])


def paper_scene(
    *,
    order: int = 1,
    targets: int = 1,
    offset_frames: float = 5.0,
    given_rate_hz: float = 10.0,
    range_m: float = 250.0,
    given_offset_s: float | None = 0.0,
) -> Scene:
    """The simulated flight of the paper's section 3.1: two cameras, 10 Hz, 5 s.

    The paper does not print its geometry; this one has two UAVs on arcs about `range_m` from up to four targets
    (more repeat them, moved and turned), with sight rays that cross at about 80 degrees. Camera 2 starts
    `offset_frames` frames later; the user is told `given_rate_hz` for it and `given_offset_s` (None: nothing).
    """
    span = (-1.0, 12.0)
    coefficients = [_paper_coefficients(n, order) for n in range(targets)]
    clocks = ((10.0, 0.0, 0.0), (given_rate_hz, offset_frames / 10.0, given_offset_s))
    cameras = tuple(
        SceneCamera(
            name=f"uav{c + 1}",
            lens=plain_lens(),
            platform=_arc_platform(range_m, azimuth_rad=np.radians(200.0 - 80.0 * c), span_s=span),
            frame_rate=10.0,
            nominal_rate=rate,
            offset_s=offset,
            given_offset_s=given,
            frames=50,
        )
        for c, (rate, offset, given) in enumerate(clocks)
    )
    return Scene(
        name="paper",
        cameras=cameras,
        targets=tuple(
            SceneTarget(name=f"target{n + 1}", motion=polynomial_motion(f"target{n + 1}", c, span))
            for n, c in enumerate(coefficients)
        ),
        origin=ORIGIN,
    )


def plain_lens(size: tuple[int, int] = (1280, 720), focal_px: float = 1000.0) -> CameraModel:
    """A pinhole without distortion."""
    width, height = size
    K = np.array([[focal_px, 0.0, (width - 1) / 2], [0.0, focal_px, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return CameraModel(image_size=size, K=K, distortion=np.zeros(5))


def _paper_coefficients(index: int, order: int) -> Floats:
    turn = np.radians(37.0) * (index // 4)
    spin = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    jerk = 0.05 * np.array([np.cos(index), np.sin(2.0 * index), 0.2])
    kind = index % 4
    rows = [_PAPER_PLACE[kind], _PAPER_VELOCITY[kind], _PAPER_ACCELERATION[kind] / 2, jerk, jerk / 10, jerk / 100]
    return np.asarray(np.array(rows[: order + 1]) @ spin.T)


def _arc_platform(range_m: float, azimuth_rad: float, span_s: tuple[float, float]) -> Platform:
    """A UAV on a rising arc around the targets, 15 m/s, whose camera looks at their middle."""
    time = np.linspace(*span_s, 14)
    flat = 0.85 * range_m
    azimuth = azimuth_rad + 15.0 * (time - 2.5) / flat
    up = 0.5 * range_m + 0.8 * (time - 2.5) + 0.15 * (time - 2.5) ** 2
    position = np.stack([flat * np.sin(azimuth), flat * np.cos(azimuth), up], axis=1)
    yaw, pitch = look_at(position, np.array([0.0, 0.0, 8.0]))
    roll = np.radians(2.0) * np.sin(0.8 * time + azimuth_rad)
    return Platform(
        position_enu_m=Path(time_s=time, value=position),
        yaw_pitch_roll_rad=Path(time_s=time, value=np.stack([yaw, pitch, roll], axis=1)),
    )
