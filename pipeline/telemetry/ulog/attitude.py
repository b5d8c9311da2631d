"""Attitudes of vehicle and gimbal out of PX4's topics: vehicle_attitude is ned_from_body as w, x, y, z."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats, whole_numbers
from calibration.foundation.errors import UsageError
from pipeline.geometry import rotation
from pipeline.telemetry.gimbals.frames import (
    ENCODER_ERROR,
    NEUTRAL,
    PITCH_LOCK,
    ROLL_LOCK,
    YAW_LOCK,
    as_outputs,
    frame_of_flags,
    held_frame,
    own_north,
    same_gimbal,
)
from pipeline.telemetry.log.flight_log import (
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import attitude_series, gimbal_series
from pipeline.telemetry.ulog.columns import Topic, floats, topic_time

OUTPUT_FLAGS = NEUTRAL | ROLL_LOCK | PITCH_LOCK | YAW_LOCK
"""What PX4 writes beside the angles of its own outputs, always (gimbal/output_rc.cpp), whatever it was asked for."""


def _quaternion(topic: Topic, name: str = "q") -> Floats:
    return np.stack([floats(topic, f"{name}[{i}]") for i in range(4)], axis=1)


def vehicle_attitude(topics: dict[str, Topic], name: str = "vehicle_attitude") -> AttitudeSeries | None:
    """The vehicle's attitudes by a topic, the estimator's or (..._groundtruth) a simulator's; None without it."""
    topic = topics.get(name)
    if topic is None:
        return None
    return attitude_series(source=name, time_s=topic_time(topic), ned_from_body=_quaternion(topic))


def gimbal_attitude(
    path: Path, instances: dict[str, dict[int, Topic]], body: AttitudeSeries | None, asked: int | None = None
) -> tuple[GimbalSeries | None, tuple[int, ...], list[str]]:
    """A gimbal device's quaternion with its flags, else mount_orientation; which gimbals differ, and notes.

    `asked` is a gimbal_device_id or an instance. Raises UsageError where the log has no such gimbal.
    """
    for name, read in (("gimbal_device_attitude_status", _device), ("mount_orientation", _orientation)):
        found = _gimbals(instances.get(name, {}))
        if not found:
            continue
        if asked is not None and asked not in found:
            raise _no_gimbal(path, asked, list(found))
        used = min(found) if asked is None else asked
        series, notes = read(name, found[used], body)
        others = [i for i in found if i != used and asked is None]
        differ = [i for i in others if not same_gimbal(series, read(name, found[i], body)[0], body)]
        if not differ:
            return series, (), notes
        names = tuple(sorted([used, *differ]))
        choice = " or ".join(map(str, names))
        said = f"{len(names)} gimbals look different ways in {name}; {used} is used: write gimbal = {choice}"
        return series, names, [said, *notes]
    if asked is not None:
        raise _no_gimbal(path, asked, [])
    return None, (), []


def _gimbals(instances: dict[int, Topic]) -> dict[int, Topic]:
    """The messages of each gimbal, by its device's number where it has one, else by its instance."""
    found: dict[int, Topic] = {}
    for number, topic in instances.items():
        device = whole_numbers(floats(topic, "gimbal_device_id"))
        for one in np.unique(device).tolist():
            rows = device == one
            mine = topic if rows.all() else {name: np.asarray(column)[rows] for name, column in topic.items()}
            name = one or number
            while name in found:  # an instance's number that is another one's device
                name += 1
            found[name] = mine
    return found


def _no_gimbal(path: Path, asked: int, there: list[int]) -> UsageError:
    return UsageError(
        where=str(path),
        seen=f"gimbal = {asked}, and gimbals in the log: {', '.join(map(str, there)) or 'none'}",
        expected="the gimbal_device_id of a gimbal in the log, or its topic's instance",
        advice="take one of them; `runningfix inspect` lists them",
    )


def _device(name: str, topic: Topic, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """Quaternions whose flags say what they count from."""
    time, flags = topic_time(topic), floats(topic, "device_flags")
    outputs = (flags == OUTPUT_FLAGS) & (np.nan_to_num(floats(topic, "received_from_mavlink")) == 0)
    frame, notes = as_outputs(name, "PX4", frame_of_flags(flags), flags, outputs)
    broken = (whole_numbers(floats(topic, "failure_flags")) & ENCODER_ERROR) != 0
    attitude = np.where(broken[:, None], np.nan, _quaternion(topic))
    series = gimbal_series(source=name, time_s=time, attitude=attitude, frame=frame)
    series, north = own_north(series, floats(topic, "delta_yaw")[np.argsort(time, kind="stable")], body)
    series, held = held_frame(series, body, commanded=bool(outputs.any()))
    return series, [*notes, *north, *held]


def _orientation(name: str, topic: Topic, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """Euler angles in radians, yaw against the vehicle."""
    roll, pitch, yaw = (floats(topic, f"attitude_euler_angle[{i}]") for i in range(3))
    q = rotation.ned_from_frd(yaw, pitch, roll)
    series = gimbal_series(source=name, time_s=topic_time(topic), attitude=q, frame=np.full(len(q), HEADING))
    return held_frame(series, body, commanded=True)
