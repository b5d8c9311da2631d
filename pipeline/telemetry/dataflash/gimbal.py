"""Gimbal attitudes out of DataFlash messages: where MNT becomes rotations."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import rotation
from pipeline.telemetry.dataflash.tables import first_instance, time_of
from pipeline.telemetry.gimbals.frames import told_frame
from pipeline.telemetry.log.flight_log import (
    EARTH,
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import gimbal_series
from pipeline.telemetry.log.tables import RawLog

OLD_MOUNT = ("ActRoll", "ActPitch", "ActYaw")


def gimbal_attitude(raw: RawLog, body: AttitudeSeries | None) -> tuple[GimbalSeries | None, list[str]]:
    """MNT, degrees: roll and pitch against the horizon, YawE against north, YawB against the vehicle.

    Old firmware has ActRoll, ActPitch, ActYaw and does not say against what.
    """
    table = first_instance(raw.table("MNT"))
    if table is None:
        return None, []
    new = "YawB" in table
    roll, pitch, yaw = (table.floats(name) for name in (("Roll", "Pitch", "YawB") if new else OLD_MOUNT))
    if not any(np.nan_to_num(angle).any() for angle in (roll, pitch, yaw)):
        return None, ["MNT says zero throughout: no mount is attached, it is not used"]
    north = table.floats("YawE")
    earth = np.isfinite(north)
    q = rotation.ned_from_frd(*np.radians([np.where(earth, north, yaw), pitch, roll]))
    frame = np.where(earth, EARTH, HEADING)
    series = gimbal_series(source="MNT", time_s=time_of(table), attitude=q, frame=frame)
    return (series, []) if new else told_frame(series, body)
