"""Gimbal attitudes out of MAVLink messages: where MOUNT_STATUS and its like become rotations.

The messages give the mount in a level frame whose x axis points north or along the vehicle's heading, as their flags
say.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation
from pipeline.telemetry.gimbals.frames import frame_of_flags, told_frame
from pipeline.telemetry.log.flight_log import (
    EARTH,
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import gimbal_series
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import Vehicle


def gimbal_attitude(vehicle: Vehicle, body: AttitudeSeries | None) -> tuple[GimbalSeries | None, list[str]]:
    """The gimbal's attitudes by the best message there is, and notes about it."""
    device = vehicle.any("GIMBAL_DEVICE_ATTITUDE_STATUS")
    if device is not None:
        device, notes = _one_gimbal(device)
        q, frame = np.asarray(device.columns["q"], float), frame_of_flags(device.floats("flags"))
        return gimbal_series(source=device.name, time_s=log_time_of(vehicle, device), attitude=q, frame=frame), notes
    table = vehicle.any("MOUNT_ORIENTATION")
    if table is not None:
        q, frame = _mount_orientation(table)
        return gimbal_series(source=table.name, time_s=log_time_of(vehicle, table), attitude=q, frame=frame), []
    table = vehicle.any("MOUNT_STATUS")
    if table is None:
        return None, []
    if not any(table.floats(f"pointing_{axis}").any() for axis in "abc"):
        return None, ["MOUNT_STATUS says zero throughout: no mount is attached, it is not used"]
    return told_frame(_mount_status(vehicle, table), body)


def _one_gimbal(table: MessageTable) -> tuple[MessageTable, list[str]]:
    """The messages of the gimbal that speaks most."""
    which = gimbal_of(table)
    many = np.bincount(which)
    best, kinds = int(many.argmax()), np.count_nonzero(many)
    if kinds == 1:
        return table, []
    said = f"{kinds} gimbals speak; component {best >> 8}, device {best & 255} is used"
    return table.only(which == best), [said]


def gimbal_of(table: MessageTable) -> Ints:
    """Which gimbal each message (n,) is of: its component * 256 + its device."""
    device = np.nan_to_num(table.floats("gimbal_device_id")).astype(np.int64)
    return np.asarray(table.component.astype(np.int64) << 8 | device)


def _mount_orientation(table: MessageTable) -> tuple[Floats, Ints]:
    """Degrees; roll and pitch against the horizon, yaw against the vehicle, yaw_absolute against north."""
    absolute, relative = table.floats("yaw_absolute"), table.floats("yaw")
    earth = np.isfinite(absolute) & ((absolute != 0) | ~np.isfinite(relative))
    yaw = np.where(earth, absolute, relative)
    q = rotation.ned_from_frd(*np.radians([yaw, table.floats("pitch"), table.floats("roll")]))
    return q, np.where(earth, EARTH, HEADING)


def _mount_status(vehicle: Vehicle, table: MessageTable) -> GimbalSeries:
    """Hundredths of a degree: a is pitch, b roll, c yaw against the vehicle."""
    pitch, roll, yaw = (table.floats(f"pointing_{axis}") / 100 for axis in "abc")
    q = rotation.ned_from_frd(*np.radians([yaw, pitch, roll]))
    frame = np.full(len(table), HEADING)
    return gimbal_series(source=table.name, time_s=log_time_of(vehicle, table), attitude=q, frame=frame)
