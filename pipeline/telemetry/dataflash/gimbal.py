"""Gimbal attitudes out of DataFlash messages: where MNT becomes rotations."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats, distinct, median
from calibration.foundation.errors import UsageError
from pipeline.geometry import rotation
from pipeline.telemetry.dataflash.tables import time_of
from pipeline.telemetry.gimbals.frames import DOUBT_DEG, attitude_at, held_frame, in_runs, same_gimbal, told_frame
from pipeline.telemetry.log.flight_log import (
    EARTH,
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import gimbal_series
from pipeline.telemetry.log.tables import MessageTable, RawLog

OLD_MOUNT = ("ActRoll", "ActPitch", "ActYaw")


def gimbal_attitude(
    raw: RawLog, body: AttitudeSeries | None, asked: int | None = None
) -> tuple[GimbalSeries | None, tuple[int, ...], list[str]]:
    """The gimbal's attitudes out of MNT, which gimbals differ, and notes; `asked` is an instance (I).

    Degrees: roll and pitch against the horizon, YawE against north, YawB against the vehicle. Old firmware has ActRoll,
    ActPitch, ActYaw and does not say against what. Raises UsageError where the asked instance is not in the log.
    """
    every = raw.table("MNT")
    instances = [] if every is None else _instances(every)
    if asked is not None and asked not in instances:
        raise UsageError(
            where=str(raw.path),
            seen=f"gimbal = {asked}, and gimbals in the log: {', '.join(map(str, instances)) or 'none'}",
            expected="the instance (I) of MNT",
            advice="take one of them; `runningfix inspect` lists them",
        )
    if every is None:
        return None, (), []
    used = instances[0] if asked is None else asked
    series, notes = _mount(_of_instance(every, used), body)
    others = [i for i in instances if i != used and asked is None]
    differ = [i for i in others if _apart(series, _mount(_of_instance(every, i), body)[0], body)]
    if not differ:
        return series, (), notes
    names = tuple(sorted([used, *differ]))
    said = f"MNT tells of gimbals {', '.join(map(str, names))}; {used} is used: write gimbal = " + " or ".join(
        map(str, names)
    )
    return series, names, [said, *notes]


def _instances(table: MessageTable) -> list[int]:
    told = table.floats("I")
    return distinct(told[np.abs(told) < 1 << 31]).astype(int).tolist() or [0]


def _of_instance(table: MessageTable, instance: int) -> MessageTable:
    told = table.floats("I")
    return table.only(np.asarray(told == instance)) if np.isfinite(told).any() else table


def _apart(first: GimbalSeries | None, second: GimbalSeries | None, body: AttitudeSeries | None) -> bool:
    """Whether the second is a gimbal of its own."""
    return second is not None and (first is None or not same_gimbal(first, second, body))


def _mount(table: MessageTable, body: AttitudeSeries | None) -> tuple[GimbalSeries | None, list[str]]:
    new = "YawB" in table
    roll, pitch, yaw = (table.floats(name) for name in (("Roll", "Pitch", "YawB") if new else OLD_MOUNT))
    if not any(np.nan_to_num(angle).any() for angle in (roll, pitch, yaw)):
        return None, ["MNT says zero throughout: no mount is attached, it is not used"]
    north = table.floats("YawE")
    unwritten = not np.nan_to_num(north).any() and np.nan_to_num(yaw).any()  # zero throughout beside one that is not
    earth = np.isfinite(north) & (not unwritten)
    time = time_of(table)
    q = rotation.ned_from_frd(*np.radians([np.where(earth, north, yaw), pitch, roll]))
    series = gimbal_series(source="MNT", time_s=time, attitude=q, frame=np.where(earth, EARTH, HEADING))
    if not new:
        return told_frame(series, body)
    against_body = rotation.ned_from_frd(*np.radians([yaw, pitch, roll]))
    series, notes = held_frame(series, body, against_body[np.argsort(time, kind="stable")], commanded=True)
    return series, [*_two_yaws(time, north, yaw, earth, body), *notes]


def _two_yaws(time: Floats, north: Floats, yaw: Floats, earth: Bools, body: AttitudeSeries | None) -> list[str]:
    """What to say where YawE is not YawB and the vehicle's heading together, all in degrees (n,)."""
    if body is None or not earth.any():
        return []
    rows = in_runs(np.flatnonzero(earth))
    at, inside = attitude_at(body, time[rows])
    heading = np.degrees(rotation.yaw_pitch_roll(at)[:, 0])
    apart = np.abs((north[rows] - yaw[rows] - heading + 180.0) % 360.0 - 180.0)[inside]
    typical = median(apart[~np.isnan(apart)]) if np.isfinite(apart).any() else 0.0
    if typical < DOUBT_DEG:
        return []
    return [f"MNT: YawE (north) and YawB (the vehicle's heading) are {typical:.1f} degrees apart; YawE is used"]
