"""What a UAV's instruments measure of the truth: poses with a constant error and with noise at the log's own rates.

The errors are those of `simulate`: one bias for the flight, and noise. As an autopilot's filters leave it, the noise
wanders, with a memory of some tenths of a second in attitude and of a second in position, instead of being new in
every sample. Its size is such that over a second or more it averages out exactly as noise that is independent from
frame to frame with the sigma of the setting (the same spectral density at low frequencies), which is what such a sigma
says in a flight file. A mounted camera's attitude error shows in the body's logged attitude, a gimbal's in the
gimbal's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_axes_turn, geodetic_from_enu
from pipeline.synthetic.scene import Platform, SceneCamera, body_pose, camera_pose
from pipeline.synthetic.simulate import Noise, disturbed

POSITION_HZ = 10
ATTITUDE_HZ = 50
ATTITUDE_MEMORY_S, POSITION_MEMORY_S = 0.15, 0.5
"""Sigma of the Gaussian that white noise is smoothed with: what is 3 of them apart is all but independent."""
BEFORE_S, AFTER_S = 4.0, 3.0
UNDULATION_M = -16.97
"""Mean sea level above the ellipsoid at the scenes' origin (EGM96)."""


@dataclass(frozen=True, kw_only=True)
class LogClock:
    """How the clocks of one UAV stand to common time; all of them run at its rate.

    boot_zero_s      autopilot's time since boot at common time 0
    utc_zero_s       POSIX time that the autopilot knows then; None: it never learned it
    recorder_zero_s  POSIX time of the ground station's clock then, right or wrong
    """

    boot_zero_s: float
    utc_zero_s: float | None
    recorder_zero_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One UAV's measurements, in its local north-east-down axes, at times since boot.

    position_boot_s    (n,), with lat_lon_height (n, 3) radians and metres above the ellipsoid, velocity_ned_mps (n, 3)
    attitude_boot_s    (m,), with ned_from_body (m, 4) and body_rate_radps (m, 3)
    ned_from_gimbal    (m, 4) at the same times, or None
    first_frame_s      time since boot of frame 0
    noise              what was drawn
    """

    clock: LogClock
    position_boot_s: Floats
    lat_lon_height: Floats
    velocity_ned_mps: Floats
    attitude_boot_s: Floats
    ned_from_body: Floats
    body_rate_radps: Floats
    ned_from_gimbal: Floats | None
    first_frame_s: float
    noise: Noise


def record(
    camera: SceneCamera, origin: Geodetic, clock: LogClock, *, noise: Noise, rng: np.random.Generator
) -> Recording:
    """Fly and log: from BEFORE_S before the first frame to AFTER_S after the last."""
    first, last = camera.frame_time_s(np.array([0, camera.frames - 1])) + clock.boot_zero_s
    slow = _stamps(first - BEFORE_S, last + AFTER_S, POSITION_HZ)
    fast = _stamps(first - BEFORE_S, last + AFTER_S, ATTITUDE_HZ)
    rotation_bias = noise.attitude_bias_rad * rng.normal(size=3)
    position_bias = noise.position_bias_m * rng.normal(size=3)
    place, _ = body_pose(camera.platform, slow - clock.boot_zero_s)
    shift = position_bias + noise.position_m * wandering(
        len(slow), rate_hz=POSITION_HZ, memory_s=POSITION_MEMORY_S, frame_hz=camera.frame_rate, rng=rng
    )
    turn = rotation_bias + noise.attitude_rad * wandering(
        len(fast), rate_hz=ATTITUDE_HZ, memory_s=ATTITUDE_MEMORY_S, frame_hz=camera.frame_rate, rng=rng
    )
    body, gimbal = _measured_attitudes(camera.platform, fast - clock.boot_zero_s, turn)
    local = _local_from_origin_ned(camera.platform, fast - clock.boot_zero_s, origin)
    return Recording(
        clock=clock,
        position_boot_s=slow,
        lat_lon_height=geodetic_from_enu(place - shift, origin),
        velocity_ned_mps=camera.platform.position_enu_m.rate(slow - clock.boot_zero_s) @ rotation.NED_FROM_ENU,
        attitude_boot_s=fast,
        ned_from_body=rotation.multiply(local, body),
        body_rate_radps=_body_rate(camera.platform, fast - clock.boot_zero_s),
        ned_from_gimbal=None if gimbal is None else rotation.multiply(local, gimbal),
        first_frame_s=float(first),
        noise=noise,
    )


def wandering(count: int, *, rate_hz: float, memory_s: float, frame_hz: float, rng: np.random.Generator) -> Floats:
    """Smooth noise (count, 3) at `rate_hz` that averages out like independent unit noise at `frame_hz`.

    White noise of variance rate / frame rate under a Gaussian of sum 1 and width `memory_s`; sampled at the frames,
    each value alone has the variance 1 / (2 sqrt(pi) memory_s frame_hz).
    """
    memory = rate_hz * memory_s
    reach = int(np.ceil(4 * memory))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / memory) ** 2)
    kernel *= np.sqrt(rate_hz / frame_hz) / kernel.sum()
    white = rng.normal(size=(count + 2 * reach, 3))
    return np.stack([np.convolve(column, kernel, mode="valid") for column in white.T], axis=1)


def _stamps(start_s: float, end_s: float, rate_hz: int) -> Floats:
    """Whole milliseconds, as autopilots stamp."""
    return np.arange(np.ceil(start_s * rate_hz), np.floor(end_s * rate_hz) + 1) / rate_hz


def _measured_attitudes(platform: Platform, time_s: Floats, turn_cam_rad: Floats) -> tuple[Floats, Floats | None]:
    """ned_from_body and ned_from_gimbal (n, 4), of which the one that carries the camera has the error."""
    _, enu_from_cam = camera_pose(platform, time_s)
    measured = disturbed(enu_from_cam, turn_cam_rad)
    ned_from_mount = rotation.multiply(
        rotation.ENU_AS_NED, rotation.multiply(measured, rotation.conjugate(rotation.CAM_AS_FRD))
    )
    _, true_body = body_pose(platform, time_s)
    if platform.gimbal_rad is not None:
        return rotation.multiply(true_body, rotation.exp(turn_cam_rad)), ned_from_mount
    body_from_mount = rotation.ned_from_frd(*(np.array(angle) for angle in platform.mount_rad))
    return rotation.multiply(ned_from_mount, rotation.conjugate(body_from_mount)), None


def _local_from_origin_ned(platform: Platform, time_s: Floats, origin: Geodetic) -> Floats:
    """Quaternion (4,) of the origin's north-east-down axes into those at the UAV: verticals differ by the distance."""
    lat, lon, height = geodetic_from_enu(platform.position_enu_m(time_s).mean(axis=0), origin)
    here = Geodetic(lat_rad=float(lat), lon_rad=float(lon), height_m=float(height))
    local_from_origin = enu_axes_turn(here, origin).T
    return rotation.from_matrix(rotation.NED_FROM_ENU @ local_from_origin @ rotation.NED_FROM_ENU.T)


def _body_rate(platform: Platform, time_s: Floats) -> Floats:
    step = 1e-3
    before, after = (body_pose(platform, time_s + s)[1] for s in (-step, step))
    return np.asarray(rotation.turn(before, after) / (2 * step))
