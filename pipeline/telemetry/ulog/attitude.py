"""Attitudes of vehicle and gimbal out of PX4's topics: vehicle_attitude is ned_from_body as w, x, y, z."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.telemetry.gimbals.frames import frame_of_flags
from pipeline.telemetry.log.flight_log import (
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import attitude_series, gimbal_series
from pipeline.telemetry.ulog.topics import Topic, floats, topic_time


def _quaternion(topic: Topic, name: str = "q") -> Floats:
    return np.stack([floats(topic, f"{name}[{i}]") for i in range(4)], axis=1)


def vehicle_attitude(topics: dict[str, Topic]) -> AttitudeSeries | None:
    """The vehicle's attitudes; None where there are none."""
    topic = topics.get("vehicle_attitude")
    if topic is None:
        return None
    return attitude_series(source="vehicle_attitude", time_s=topic_time(topic), ned_from_body=_quaternion(topic))


def gimbal_attitude(topics: dict[str, Topic]) -> GimbalSeries | None:
    """A gimbal device's quaternion with its flags, else mount_orientation (Euler radians, yaw against the vehicle)."""
    topic = topics.get("gimbal_device_attitude_status")
    if topic is not None:
        frame = frame_of_flags(floats(topic, "device_flags"))
        return gimbal_series(
            source="gimbal_device_attitude_status", time_s=topic_time(topic), attitude=_quaternion(topic), frame=frame
        )
    topic = topics.get("mount_orientation")
    if topic is None:
        return None
    roll, pitch, yaw = (floats(topic, f"attitude_euler_angle[{i}]") for i in range(3))
    q = rotation.ned_from_frd(yaw, pitch, roll)
    frame = np.full(len(q), HEADING)
    return gimbal_series(source="mount_orientation", time_s=topic_time(topic), attitude=q, frame=frame)
