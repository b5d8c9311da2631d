"""From MAVLink messages to a FlightLog: which vehicle, which messages, what they mean.

Units and frames are those of the message definitions: GLOBAL_POSITION_INT and the GPS messages give 1e-7 degrees and
millimetres above mean sea level, ATTITUDE gives the FRD body in NED, the gimbal messages give the mount in a level
frame whose x axis points north or along the vehicle's heading, as their flags say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.telemetry.clocks import BootClock, boot_clock, fit_clock, plausible_utc
from pipeline.telemetry.flight_log import (
    EARTH,
    HEADING,
    Accuracy,
    AttitudeSeries,
    ClockFit,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.gimbal_frames import frame_of_flags, told_frame
from pipeline.telemetry.heights import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.series import attitude_series, denser, gimbal_series, median_of, position_series
from pipeline.telemetry.tables import MessageTable, RawLog

GPS_MESSAGES = ("GPS_RAW_INT", "GPS2_RAW")
POSITION_MESSAGES = ("GLOBAL_POSITION_INT", *GPS_MESSAGES, "AHRS2")
BOOT_MESSAGES = ("ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "SYSTEM_TIME")
UNIX_US = 1e15
"""A time in microseconds above this counts from 1970, below it from boot: 1e15 us are 31 years."""
UTC_FLOOR_S = 0.05
NO_AUTOPILOT = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class _Vehicle:
    """One vehicle's messages and its clock."""

    raw: RawLog
    system: int
    component: int
    clock: BootClock

    def own(self, name: str) -> MessageTable | None:
        """Messages of the autopilot itself."""
        return self.raw.table(name, lambda t: (t.system == self.system) & (t.component == self.component))

    def any(self, name: str) -> MessageTable | None:
        """Messages of every component of the vehicle."""
        return self.raw.table(name, lambda t: np.asarray(t.system == self.system))


def mavlink_flight(raw: RawLog, *, system: int | None = None) -> FlightLog:
    """What one vehicle's MAVLink messages say; of several, the one with most positions unless `system` names it.

    Raises InputFileError where no autopilot (or not the named one) speaks in the log.
    """
    chosen, notes = _choose(raw, system)
    clock = boot_clock(*boot_readings(raw, chosen))
    vehicle = _Vehicle(raw=raw, system=chosen[0], component=chosen[1], clock=clock)
    notes += _clock_notes(vehicle.clock)
    utc = _utc(vehicle)
    position = _position(vehicle)
    attitude = _attitude(vehicle)
    gimbal, gimbal_notes = _gimbal(vehicle, attitude)
    events, event_source = _camera_events(vehicle, utc)
    return FlightLog(
        path=raw.path,
        format=raw.format,
        system=chosen[0],
        component=chosen[1],
        counts=raw.counts,
        corrupt_packets=raw.corrupt_packets,
        position=position,
        attitude=attitude,
        gimbal=gimbal,
        camera_event_s=events,
        camera_event_source=event_source,
        utc=utc,
        record_clock=vehicle.clock.record,
        accuracy=_accuracy(vehicle),
        notes=(*raw.notes, *notes, *gimbal_notes),
    )


def _choose(raw: RawLog, system: int | None) -> tuple[tuple[int, int], list[str]]:
    """System and component of the autopilot, and what to say about the choice."""
    votes = votes_of(raw)
    if system is not None:
        votes = {who: n for who, n in votes.items() if who[0] == system}
    if not votes:
        whom = "an autopilot" if system is None else f"system {system}"
        raise InputFileError(
            where=str(raw.path),
            seen=f"no position, attitude or heartbeat of {whom} among {sum(raw.counts.values())} messages"
            f" ({raw.corrupt_packets} corrupt packets)",
            expected="a MAVLink log of a vehicle",
            advice="check that it is the telemetry log of the flight"
            + ("" if system is None else f"; systems in it: {sorted({who[0] for who in votes_of(raw)})}"),
        )
    best = max(votes, key=lambda who: (votes[who], -who[0], -who[1]))
    others = sorted({who[0] for who in votes} - {best[0]})
    said = f"vehicles {', '.join(map(str, others))} are in the log too; system {best[0]} has the most positions"
    return best, [said] if others else []


def votes_of(raw: RawLog) -> dict[tuple[int, int], tuple[int, int, int]]:
    """(system, component) -> how many positions, attitudes and heartbeats it sent."""
    votes: dict[tuple[int, int], list[int]] = {}
    groups = (POSITION_MESSAGES, ("ATTITUDE", "ATTITUDE_QUATERNION"), ("HEARTBEAT",))
    for slot, names in enumerate(groups):
        for name in names:
            table = raw.table(name)
            if table is None:
                continue
            if name == "HEARTBEAT":
                table = table.only(np.asarray(table.floats("autopilot") != NO_AUTOPILOT))
            many = np.bincount(table.system.astype(np.int64) << 8 | table.component)
            for who in np.flatnonzero(many).tolist():
                votes.setdefault((who >> 8, who & 255), [0, 0, 0])[slot] += int(many[who])
    return {who: (n[0], n[1], n[2]) for who, n in votes.items()}


def boot_readings(raw: RawLog, chosen: tuple[int, int]) -> tuple[Ints, Floats, Floats]:
    """Places, boot times and the recorder's times beside them, each (n,), in the order of the file."""
    asked = (raw.table(name, lambda t: (t.system == chosen[0]) & (t.component == chosen[1])) for name in BOOT_MESSAGES)
    found = [table for table in asked if table is not None]
    if not found:
        return np.empty(0, np.int64), np.empty(0), np.empty(0)
    place = np.concatenate([table.place for table in found])
    order = np.argsort(place, kind="stable")
    boot_s, record_s = (
        np.concatenate(columns)[order]
        for columns in ([t.floats("time_boot_ms") / 1000 for t in found], [t.record_time_s for t in found])
    )
    return place[order], boot_s, record_s


def _clock_notes(clock: BootClock) -> list[str]:
    notes = []
    for place, shift in zip(clock.restart_place.tolist(), clock.shift_s[1:].tolist(), strict=True):
        at = float(clock.log_s[np.searchsorted(clock.place, place)])
        notes.append(
            f"the vehicle started anew at log time {at:.1f} s; from there log time is its boot time + {shift:.1f} s"
        )
    if clock.record is not None and clock.record.outliers > 0:
        notes.append(
            f"{clock.record.outliers} of the recorder's timestamps disagree with the vehicle's clock and are not used"
        )
    return notes


def _utc(vehicle: _Vehicle) -> ClockFit | None:
    table = vehicle.own("SYSTEM_TIME")
    if table is None:
        return None
    unix = table.floats("time_unix_usec") * 1e-6
    log = vehicle.clock.of_boot_time(table.place, table.floats("time_boot_ms") / 1000)
    return fit_clock("SYSTEM_TIME", log, np.where(plausible_utc(unix), unix, np.nan), floor_s=UTC_FLOOR_S)


def _time(vehicle: _Vehicle, table: MessageTable, utc: ClockFit | None = None) -> Floats:
    """Log time (n,) of a table, by the best its messages carry."""
    arrived = vehicle.clock.of_record(table.place, table.record_time_s)
    if "time_boot_ms" in table:
        boot = table.floats("time_boot_ms") / 1000
        if np.all(table.component == vehicle.component):
            return vehicle.clock.of_boot_time(table.place, boot)
        return vehicle.clock.of_other_boot_time(table.place, table.record_time_s, boot)[0]
    if "time_usec" in table:
        usec = table.floats("time_usec")
        since_boot = vehicle.clock.of_boot_time(table.place, usec * 1e-6)
        since_1970 = arrived if utc is None else utc.log_epoch_s + (usec * 1e-6 - utc.epoch_s) / utc.rate
        stated = np.where(usec >= UNIX_US, since_1970, since_boot)
        return np.where((usec > 0) & (np.abs(stated - arrived) < 5.0), stated, arrived)
    return arrived


def _position(vehicle: _Vehicle) -> PositionSeries | None:
    undulation = _undulation(vehicle)
    for name in POSITION_MESSAGES:
        table = vehicle.own(name)
        if table is not None:
            series = _position_of(vehicle, table, undulation)
            if series.valid.sum() >= 2:
                return series
    return None


def _position_of(vehicle: _Vehicle, table: MessageTable, undulation: Undulation | None) -> PositionSeries:
    lat, lon = table.floats("lat"), table.floats("lng" if table.name == "AHRS2" else "lon")
    height = table.floats("altitude") if table.name == "AHRS2" else table.floats("alt") / 1000
    bad = (lat == 0) & (lon == 0)
    if table.name in GPS_MESSAGES:
        bad |= table.floats("fix_type") < 3
    lat_deg, lon_deg = (np.where(bad, np.nan, angle / 1e7) for angle in (lat, lon))
    words, height = on_ellipsoid(height, undulation, lat_deg, lon_deg)
    if table.name in GPS_MESSAGES and "alt_ellipsoid" in table and undulation is not None:
        own = table.floats("alt_ellipsoid")
        height = np.where(own != 0, own / 1000, height)
    return position_series(
        source=table.name,
        datum="ellipsoid",
        height_from=words,
        time_s=_time(vehicle, table),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=np.where(bad, np.nan, height),
        velocity_ned_mps=_velocity(table),
    )


def _velocity(table: MessageTable) -> Floats:
    if table.name == "GLOBAL_POSITION_INT":
        return np.stack([table.floats(axis) / 100 for axis in ("vx", "vy", "vz")], axis=1)
    return np.full((len(table), 3), np.nan)


def _undulation(vehicle: _Vehicle) -> Undulation | None:
    """Ellipsoid minus mean sea level, from the receiver that gives both."""
    for name in GPS_MESSAGES:
        table = vehicle.own(name)
        if table is None or "alt_ellipsoid" not in table:
            continue
        both = (table.floats("alt_ellipsoid") != 0) & (table.floats("fix_type") >= 3)
        found = undulation_of(name, table.floats("alt_ellipsoid")[both] / 1000 - table.floats("alt")[both] / 1000)
        if found is not None:
            return found
    return None


def _attitude(vehicle: _Vehicle) -> AttitudeSeries | None:
    exact, euler = vehicle.own("ATTITUDE_QUATERNION"), vehicle.own("ATTITUDE")
    table = denser(exact, euler)
    if table is None:
        return None
    if table.name == "ATTITUDE":
        q = rotation.ned_from_frd(table.floats("yaw"), table.floats("pitch"), table.floats("roll"))
    else:
        q = np.stack([table.floats(f"q{i}") for i in (1, 2, 3, 4)], axis=1)
    return attitude_series(source=table.name, time_s=_time(vehicle, table), ned_from_body=q)


def _gimbal(vehicle: _Vehicle, body: AttitudeSeries | None) -> tuple[GimbalSeries | None, list[str]]:
    device = vehicle.any("GIMBAL_DEVICE_ATTITUDE_STATUS")
    if device is not None:
        device, notes = _one_gimbal(device)
        q, frame = np.asarray(device.columns["q"], float), frame_of_flags(device.floats("flags"))
        return gimbal_series(source=device.name, time_s=_time(vehicle, device), attitude=q, frame=frame), notes
    table = vehicle.any("MOUNT_ORIENTATION")
    if table is not None:
        q, frame = _mount_orientation(table)
        return gimbal_series(source=table.name, time_s=_time(vehicle, table), attitude=q, frame=frame), []
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


def _mount_status(vehicle: _Vehicle, table: MessageTable) -> GimbalSeries:
    """Hundredths of a degree: a is pitch, b roll, c yaw against the vehicle."""
    pitch, roll, yaw = (table.floats(f"pointing_{axis}") / 100 for axis in "abc")
    q = rotation.ned_from_frd(*np.radians([yaw, pitch, roll]))
    frame = np.full(len(table), HEADING)
    return gimbal_series(source=table.name, time_s=_time(vehicle, table), attitude=q, frame=frame)


def _camera_events(vehicle: _Vehicle, utc: ClockFit | None) -> tuple[Floats, str]:
    for name in ("CAMERA_IMAGE_CAPTURED", "CAMERA_FEEDBACK", "CAMERA_TRIGGER"):
        table = vehicle.any(name)
        if table is None:
            continue
        if name == "CAMERA_IMAGE_CAPTURED":
            table = table.only(np.asarray(table.floats("capture_result") == 1))
        time = _time(vehicle, table, utc)
        time = np.unique(time[np.isfinite(time)])
        if len(time):
            return time, name
    return np.empty(0), ""


def _accuracy(vehicle: _Vehicle) -> Accuracy:
    for name in GPS_MESSAGES:
        table = vehicle.own(name)
        if table is None or "h_acc" not in table:
            continue
        fixed = table.floats("fix_type") >= 3
        horizontal, vertical = (median_of(table.floats(f)[fixed] / 1000, 100.0) for f in ("h_acc", "v_acc"))
        yaw = table.floats("yaw")[fixed]
        dual = np.isfinite(yaw) & (yaw != 0) & (yaw != 65535)
        heading = median_of(np.radians(table.floats("hdg_acc")[fixed][dual] / 1e5), 1.0)
        if np.isfinite([horizontal, vertical]).any():
            return Accuracy(horizontal_m=horizontal, vertical_m=vertical, heading_rad=heading, source=name)
    table = vehicle.own("ESTIMATOR_STATUS")
    if table is None:
        return Accuracy()
    horizontal, vertical = (median_of(table.floats(f"pos_{axis}_accuracy"), 100.0) for axis in ("horiz", "vert"))
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source=table.name)
