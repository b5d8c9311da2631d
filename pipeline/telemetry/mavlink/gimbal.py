"""Gimbal attitudes out of MAVLink messages: where MOUNT_STATUS and its like become rotations.

The messages give the mount in a level frame whose x axis points north or along the vehicle's heading, as their flags
say.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.foundation.arrays import Floats, Ints, whole_numbers
from calibration.foundation.errors import UsageError
from pipeline.geometry import rotation
from pipeline.telemetry.gimbals.frames import (
    ENCODER_ERROR,
    as_outputs,
    frame_of_flags,
    held_frame,
    own_north,
    same_gimbal,
    told_frame,
)
from pipeline.telemetry.log.flight_log import (
    EARTH,
    HEADING,
    AttitudeSeries,
    GimbalSeries,
)
from pipeline.telemetry.log.series import gimbal_series
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import AUTOPILOT_NAMES, Vehicle, autopilots_of

Reader = Callable[[Vehicle, MessageTable, AttitudeSeries | None], tuple[GimbalSeries, list[str]]]


def gimbal_attitude(
    vehicle: Vehicle, body: AttitudeSeries | None, asked: int | None = None
) -> tuple[GimbalSeries | None, tuple[int, ...], list[str]]:
    """The gimbal's attitudes by the best message there is, which gimbals differ, and notes.

    `asked` names one by its device or its component. Raises UsageError where it does not speak.
    """
    for name, read in READERS:
        table = vehicle.any(name)
        if table is None:
            continue
        if name == "MOUNT_STATUS" and not any(table.floats(f"pointing_{axis}").any() for axis in "abc"):
            return None, (), ["MOUNT_STATUS says zero throughout: no mount is attached, it is not used"]
        table, others, notes = _one_gimbal(vehicle, table, read, body, asked)
        series, said = read(vehicle, table, body)
        return series, others, [*notes, *said]
    if asked is not None:
        raise _no_gimbal(vehicle, asked, [])
    return None, (), _strangers(vehicle)


def _strangers(vehicle: Vehicle) -> list[str]:
    """What to say where only systems without an autopilot send a gimbal's attitudes: one whose id was never set."""
    for name, _ in READERS:
        table = vehicle.raw.table(name)
        others = set() if table is None else set(np.unique(table.system).tolist()) - autopilots_of(vehicle.raw)
        if others:
            senders = ", ".join(map(str, sorted(others)))
            return [
                f"{name} is sent by system {senders}, not by the vehicle's {vehicle.system}: it is not used;"
                " a gimbal on the vehicle should have its system id"
            ]
    return []


def _one_gimbal(
    vehicle: Vehicle, table: MessageTable, read: Reader, body: AttitudeSeries | None, asked: int | None
) -> tuple[MessageTable, tuple[int, ...], list[str]]:
    """The messages of the gimbal that is asked for, else of the one that speaks most; the gimbals, if they differ."""
    which = gimbal_of(table)
    many = np.bincount(which)
    codes = np.flatnonzero(many).tolist()
    if asked is not None:
        mine = [c for c in codes if _name(c) == asked] or [c for c in codes if c >> 8 == asked]
        if not mine:
            raise _no_gimbal(vehicle, asked, codes)
        return table.only(which == max(mine, key=lambda c: int(many[c]))), (), []
    best = int(many.argmax())
    if len(codes) == 1:
        return table, (), []
    used = table.only(which == best)
    mine_series = read(vehicle, used, body)[0]
    differ = [
        c
        for c in codes
        if c != best and not same_gimbal(mine_series, read(vehicle, table.only(which == c), body)[0], body)
    ]
    where = f"component {best >> 8}, device {best & 255} is used"
    if not differ:
        senders = " and ".join(str(c >> 8) for c in codes)
        return used, (), [f"components {senders} tell of the same gimbal in {table.name}; {where}"]
    names = tuple(sorted({_name(c) for c in [best, *differ]}))
    said = f"{len(codes)} gimbals speak and look different ways; {where}: write gimbal = {' or '.join(map(str, names))}"
    return used, names, [said]


def _name(code: int) -> int:
    """How the flight file names a gimbal: by its device where it has a number, else by its component."""
    return code & 255 or code >> 8


def _no_gimbal(vehicle: Vehicle, asked: int, codes: list[int]) -> UsageError:
    there = ", ".join(str(_name(c)) for c in codes) or "none"
    return UsageError(
        where=str(vehicle.raw.path),
        seen=f"gimbal = {asked}, and gimbals in the log: {there}",
        expected="the device or component id of a gimbal that speaks in the log",
        advice="take one of them; `runningfix inspect` lists them",
    )


def gimbal_of(table: MessageTable) -> Ints:
    """Which gimbal each message (n,) is of: its component * 256 + its device."""
    device = whole_numbers(table.floats("gimbal_device_id"))
    return np.asarray(table.component.astype(np.int64) << 8 | device)


def _mount_orientation(table: MessageTable) -> tuple[Floats, Ints]:
    """Degrees; roll and pitch against the horizon, yaw against the vehicle, yaw_absolute against north."""
    absolute, relative = table.floats("yaw_absolute"), table.floats("yaw")
    earth = np.isfinite(absolute) & ((absolute != 0) | ~np.isfinite(relative))
    yaw = np.where(earth, absolute, relative)
    q = rotation.ned_from_frd(*np.radians([yaw, table.floats("pitch"), table.floats("roll")]))
    return q, np.where(earth, EARTH, HEADING)


def _device(vehicle: Vehicle, table: MessageTable, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """Quaternions whose flags say what they count from."""
    flags = table.floats("flags")
    frame = frame_of_flags(flags)
    q = np.array(table.columns["q"], float)
    q[(whole_numbers(table.floats("failure_flags")) & ENCODER_ERROR) != 0] = np.nan
    who = AUTOPILOT_NAMES.get(vehicle.autopilot, "")
    own = bool(who) and bool(np.all(table.component == vehicle.component))
    frame, notes = as_outputs(table.name, who, frame, flags, np.full(len(table), own))
    time = log_time_of(vehicle, table)
    series = gimbal_series(source=table.name, time_s=time, attitude=q, frame=frame)
    del q
    series, north = own_north(series, table.floats("delta_yaw")[np.argsort(time, kind="stable")], body)
    series, held = held_frame(series, body, commanded=own)
    return series, [*notes, *north, *held]


def _orientation(vehicle: Vehicle, table: MessageTable, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    q, frame = _mount_orientation(table)
    series = gimbal_series(source=table.name, time_s=log_time_of(vehicle, table), attitude=q, frame=frame)
    relative = rotation.ned_from_frd(*np.radians([table.floats(angle) for angle in ("yaw", "pitch", "roll")]))
    order = np.argsort(log_time_of(vehicle, table), kind="stable")
    own = bool(np.all(table.component == vehicle.component))
    return held_frame(series, body, relative[order], commanded=own)


def _mount_status(vehicle: Vehicle, table: MessageTable, body: AttitudeSeries | None) -> tuple[GimbalSeries, list[str]]:
    """Hundredths of a degree: a is pitch, b roll, c yaw against the vehicle."""
    pitch, roll, yaw = (table.floats(f"pointing_{axis}") / 100 for axis in "abc")
    q = rotation.ned_from_frd(*np.radians([yaw, pitch, roll]))
    frame = np.full(len(table), HEADING)
    series = gimbal_series(source=table.name, time_s=log_time_of(vehicle, table), attitude=q, frame=frame)
    return told_frame(series, body)


READERS: tuple[tuple[str, Reader], ...] = (
    ("GIMBAL_DEVICE_ATTITUDE_STATUS", _device),
    ("MOUNT_ORIENTATION", _orientation),
    ("MOUNT_STATUS", _mount_status),
)
"""The best first."""
