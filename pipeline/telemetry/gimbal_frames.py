"""What the yaw of a gimbal's quaternion counts from.

GIMBAL_DEVICE_ATTITUDE_STATUS gives level_from_mount: roll and pitch always against the horizon. Its level frame's x
axis points north (earth frame) or along the vehicle's heading (vehicle frame), as the flags say. Where neither frame
flag is set, an older definition holds: yaw lock means north.
"""

from __future__ import annotations

import numpy as np

from calibration.arrays import Bools, Floats
from pipeline.geometry import rotation

YAW_LOCK = 16
YAW_IN_VEHICLE_FRAME = 32
YAW_IN_EARTH_FRAME = 64


def yaw_is_earth(flags: Floats) -> Bools:
    """True (n,) where yaw counts from north, of GIMBAL_DEVICE_FLAGS."""
    bits = np.asarray(flags).astype(np.int64)
    stated = (bits & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME)) != 0
    return np.asarray(np.where(stated, (bits & YAW_IN_VEHICLE_FRAME) == 0, (bits & YAW_LOCK) != 0))


def heading_turn(ned_from_body: Floats) -> Floats:
    """ned_from_level (n, 4): the turn about down by the vehicle's heading."""
    yaw = rotation.yaw_pitch_roll(ned_from_body)[..., 0]
    zero = np.zeros_like(yaw)
    return rotation.exp(np.stack([zero, zero, yaw], axis=-1))
