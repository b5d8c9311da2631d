"""What a gimbal's angles count from.

GIMBAL_DEVICE_ATTITUDE_STATUS keeps roll and pitch against the horizon; its yaw counts from north (earth frame) or
from the vehicle's heading (vehicle frame), as the flags say. Where neither frame flag is set, an older definition
holds: yaw lock means north.

MOUNT_STATUS and old MNT do not say it: stabilised mounts send angles against the horizon, mounts on servos send the
servos' angles, against the body. A mount that is stabilised keeps the horizon steady in one of the two readings, and
that reading is taken.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.telemetry.log.flight_log import BODY, EARTH, HEADING, AttitudeSeries, GimbalSeries

YAW_LOCK = 16
YAW_IN_VEHICLE_FRAME = 32
YAW_IN_EARTH_FRAME = 64
STEADIER = 0.5
"""Against the body, if that leaves less than this share of the unrest; both leave the same where nothing moves."""
FRAME_NAMES = {
    EARTH: "north and the horizon",
    HEADING: "the vehicle's heading and the horizon",
    BODY: "the vehicle's body",
}


def frame_of_flags(flags: Floats) -> Ints:
    """EARTH or HEADING (n,) of GIMBAL_DEVICE_FLAGS."""
    bits = np.asarray(flags).astype(np.int64)
    stated = (bits & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME)) != 0
    earth = np.where(stated, (bits & YAW_IN_VEHICLE_FRAME) == 0, (bits & YAW_LOCK) != 0)
    return np.where(earth, EARTH, HEADING)


def heading_turn(ned_from_body: Floats) -> Floats:
    """ned_from_level (n, 4): the turn about down by the vehicle's heading."""
    yaw = rotation.yaw_pitch_roll(ned_from_body)[..., 0]
    zero = np.zeros_like(yaw)
    return rotation.exp(np.stack([zero, zero, yaw], axis=-1))


def ned_from_mount(attitude: Floats, frame: Ints, ned_from_body: Floats) -> Floats:
    """ned_from_mount (n, 4) of mount attitudes (n, 4) in their frames (n,), by the body's attitude (n, 4) then."""
    nothing = np.array([1.0, 0.0, 0.0, 0.0])
    kind = np.asarray(frame)[:, None]
    turn = np.where(kind == EARTH, nothing, np.where(kind == BODY, ned_from_body, heading_turn(ned_from_body)))
    return rotation.multiply(turn, attitude)


def steadier_frame(gimbal: GimbalSeries, body: AttitudeSeries | None) -> int:
    """HEADING or BODY: in which of the two the mount keeps the horizon steadier."""
    if body is None or body.valid.sum() < 2 or gimbal.valid.sum() < 10:
        return HEADING
    stamp, q = body.time_s[body.valid], body.ned_from_body[body.valid]
    inside = gimbal.valid & (gimbal.time_s >= stamp[0]) & (gimbal.time_s <= stamp[-1])
    time, mount = gimbal.time_s[inside], gimbal.attitude[inside]
    left = np.clip(np.searchsorted(stamp, time, side="right") - 1, 0, len(stamp) - 2)
    step = stamp[left + 1] - stamp[left]
    share = np.where(step > 0, (time - stamp[left]) / np.where(step > 0, step, 1.0), 0.0)
    turned = rotation.slerp(q[left], q[left + 1], share)
    unrest = _unrest(mount)
    return BODY if _unrest(rotation.multiply(turned, mount)) < STEADIER * unrest else HEADING


def _unrest(frame_from_mount: Floats) -> float:
    """Mean square of the changes of pitch and roll from sample to sample, the largest tenth left out."""
    change = np.diff(rotation.yaw_pitch_roll(frame_from_mount)[:, 1:], axis=0)
    square = np.sort((change**2).sum(axis=1))
    return float(square[: max(1, int(0.9 * len(square)))].mean()) if len(square) else 0.0


def told_frame(gimbal: GimbalSeries, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """A mount whose messages do not say what they count from, with the frame its motion tells, and a note."""
    frame = steadier_frame(gimbal, body)
    note = f"{gimbal.source} does not say what its angles count from; by the vehicle's motion: {FRAME_NAMES[frame]}"
    return replace(gimbal, frame=np.full(len(gimbal.frame), frame)), [note]
