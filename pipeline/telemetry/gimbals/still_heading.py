"""A gimbal's heading that never moves while the vehicle turns, in formats whose angles count from north.

A gimbal that is locked to north does so; so does an export that counts the heading from the vehicle's nose, or writes
what was asked for. An encoder's angle under a turning vehicle is never still to the last digit for another reason.
"""

from __future__ import annotations

import numpy as np

from pipeline.geometry import rotation
from pipeline.telemetry.gimbals.frames import STEEP_RAD, TURNING_RAD, beside_body
from pipeline.telemetry.log.flight_log import EARTH, AttitudeSeries, GimbalSeries

STILL_HEADING_RAD = np.radians(0.05)
"""Less than the last digit of DJI's angles."""


def still_heading(gimbal: GimbalSeries | None, body: AttitudeSeries | None) -> tuple[str, ...]:
    """What to say of a mount that counts from north where its heading stays while the vehicle's does not."""
    seen = None if gimbal is None or (gimbal.frame != EARTH).any() else beside_body(gimbal, body)
    if gimbal is None or seen is None:
        return ()
    mount, turned = (rotation.yaw_pitch_roll(q) for q in seen)
    level = np.abs(mount[:, 1]) < STEEP_RAD
    yaw, heading = np.unwrap(mount[level, 0]), np.unwrap(turned[level, 0])
    if len(yaw) < 10 or np.ptp(yaw) > STILL_HEADING_RAD or np.std(heading) < TURNING_RAD:
        return ()
    return (
        f"{gimbal.source}: the gimbal's heading never moves while the vehicle turns by"
        f" {np.degrees(np.ptp(heading)):.0f} degrees: it holds north, or it counts from the vehicle's nose, and then"
        " the camera looks elsewhere by the vehicle's heading; it is read against north",
    )
