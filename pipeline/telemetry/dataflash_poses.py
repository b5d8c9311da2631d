"""From DataFlash messages to a FlightLog.

Times are TimeUS (or TimeMS) since boot, except in GPS of old firmware, where TimeMS is the GPS week's and T the boot's.
Heights in POS, GPS, AHR2 are above mean sea level. Quaternions (XKQ, NKQ1) turn the autopilot's axes, so the board's
trim is taken out of them: ned_from_body = ned_from_board * board_from_body(-trim); ATT already has it out.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.telemetry.clocks import fit_clock, plausible_utc, settled, utc_from_gps
from pipeline.telemetry.dataflash_local import local_position, of_core
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
from pipeline.telemetry.gimbal_frames import told_frame
from pipeline.telemetry.heights import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.series import attitude_series, denser, gimbal_series, median_of, position_series
from pipeline.telemetry.tables import MessageTable, RawLog

POSITION_MESSAGES = ("POS", "XKF1", "GPS", "AHR2")
"""The best first; XKF1 stands for NKF1 too."""
GPS_UTC_FLOOR_S = 0.2
"""A receiver's message is logged when it has arrived and been parsed, 0.1 to 0.2 s after the moment it speaks of."""
OLD_MOUNT = ("ActRoll", "ActPitch", "ActYaw")
TRIM_NAMES = ("AHRS_TRIM_X", "AHRS_TRIM_Y", "AHRS_TRIM_Z")


def dataflash_flight(raw: RawLog) -> FlightLog:
    """What a DataFlash log says of its vehicle."""
    position = _position(raw)
    attitude = _attitude(raw)
    gimbal, gimbal_notes = _gimbal(raw, attitude)
    events, source = _camera_events(raw)
    return FlightLog(
        path=raw.path,
        format=raw.format,
        counts=raw.counts,
        corrupt_packets=raw.corrupt_packets,
        position=position,
        attitude=attitude,
        gimbal=gimbal,
        camera_event_s=events,
        camera_event_source=source,
        utc=_utc(raw),
        accuracy=_accuracy(raw),
        notes=(*raw.notes, *gimbal_notes),
    )


def time_of(table: MessageTable) -> Floats:
    """Log time (n,): seconds since boot; NaN where the message has none or its neighbours deny it."""
    if table.name == "GPS" and "T" in table:
        return settled(table.floats("T") / 1e3)
    if "TimeUS" in table:
        return settled(table.floats("TimeUS") / 1e6)
    return settled(table.floats("TimeMS") / 1e3)


def _first(table: MessageTable | None) -> MessageTable | None:
    """The messages of the first instance, where messages name one."""
    if table is None:
        return None
    for name in ("I", "C"):
        if name in table:
            return table.only(np.asarray(table.floats(name) == table.floats(name).min()))
    return table


def _gps(raw: RawLog) -> MessageTable | None:
    """GPS of the receiver in use (U), else of the first."""
    table = raw.table("GPS")
    if table is not None and "U" in table and (table.floats("U") == 1).any():
        return table.only(np.asarray(table.floats("U") == 1))
    return _first(table)


def _position(raw: RawLog) -> PositionSeries | None:
    undulation = _undulation(raw)
    for name in POSITION_MESSAGES:
        if name == "XKF1":
            local = _local(raw, undulation)
            if local is not None and local.valid.sum() >= 2:
                return local
            continue
        table = _gps(raw) if name == "GPS" else raw.table(name)
        if table is None:
            continue
        series = _position_of(table, undulation)
        if series.valid.sum() >= 2:
            return series
    return None


def _position_of(table: MessageTable, undulation: Undulation | None) -> PositionSeries:
    lat, lon = table.floats("Lat"), table.floats("Lng")
    bad = (lat == 0) & (lon == 0)
    velocity = np.full((len(table), 3), np.nan)
    if table.name == "GPS":
        bad |= table.floats("Status") < 3
        speed, course = table.floats("Spd"), np.radians(table.floats("GCrs"))
        velocity = np.stack([speed * np.cos(course), speed * np.sin(course), table.floats("VZ")], axis=1)
    lat_deg, lon_deg = (np.where(bad, np.nan, angle) for angle in (lat, lon))
    words, height = on_ellipsoid(table.floats("Alt"), undulation, lat_deg, lon_deg)
    return position_series(
        source=table.name,
        datum="ellipsoid",
        height_from=words,
        time_s=time_of(table),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=np.where(bad, np.nan, height),
        velocity_ned_mps=velocity,
    )


def _local(raw: RawLog, undulation: Undulation | None) -> PositionSeries | None:
    found = local_position(raw)
    if found is None:
        return None
    table, lat_deg, lon_deg, height = found
    words, height = on_ellipsoid(height, undulation, lat_deg, lon_deg)
    return position_series(
        source=table.name, datum="ellipsoid", height_from=words, time_s=time_of(table), lat_deg=lat_deg,
        lon_deg=lon_deg, height_m=height,
        velocity_ned_mps=np.stack([table.floats(name) for name in ("VN", "VE", "VD")], axis=1),
    )  # fmt: skip


def _undulation(raw: RawLog) -> Undulation | None:
    """From GPA.Und, or from GPA.AEl (height above the ellipsoid) beside GPS.Alt.

    ArduPilot counts Und from mean sea level up to the ellipsoid: the negative of the geoid's height above it.
    """
    gpa, gps = _first(raw.table("GPA")), _gps(raw)
    if gpa is None or gps is None:
        return None
    if "Und" in gpa:
        said = gpa.floats("Und")
        return undulation_of("GPA.Und", -said[said != 0])
    if "AEl" in gpa:
        fixed = gps.only(np.asarray(gps.floats("Status") >= 3))
        if len(fixed) == 0:
            return None
        near = np.interp(time_of(gpa), time_of(fixed), fixed.floats("Alt"))
        above = gpa.floats("AEl")
        return undulation_of("GPA.AEl", (above - near)[above != 0])
    return None


def _attitude(raw: RawLog) -> AttitudeSeries | None:
    exact = primary_core(raw)
    table = denser(exact, raw.table("ATT"))
    if table is None:
        return None
    if table.name == "ATT":
        q = rotation.ned_from_frd(*np.radians([table.floats(angle) for angle in ("Yaw", "Pitch", "Roll")]))
    else:
        board = np.stack([table.floats(f"Q{i}") for i in (1, 2, 3, 4)], axis=1)
        q = rotation.multiply(board, rotation.exp(-_trim(raw)))
    return attitude_series(source=table.name, time_s=time_of(table), ned_from_body=q)


def primary_core(raw: RawLog) -> MessageTable | None:
    """Quaternions of the estimator's core that flew, if it was the same one all the time."""
    for name, status in (("XKQ", "XKF4"), ("NKQ1", "NKF4"), ("XKQ1", "XKF4")):
        table, state = raw.table(name), raw.table(status)
        if table is not None and ("C" not in table or of_core(table, state) is not None):
            return of_core(table, state)
    return None


def _trim(raw: RawLog) -> Floats:
    """The board's trim (3,) roll, pitch, yaw in radians, as the parameters give it last."""
    table = raw.table("PARM")
    if table is None:
        return np.zeros(3)
    value = dict(zip(table.columns["Name"].tolist(), table.floats("Value").tolist(), strict=True))
    return np.array([value.get(name.encode(), 0.0) for name in TRIM_NAMES])


def _gimbal(raw: RawLog, body: AttitudeSeries | None) -> tuple[GimbalSeries | None, list[str]]:
    """MNT, degrees: roll and pitch against the horizon, YawE against north, YawB against the vehicle.

    Old firmware has ActRoll, ActPitch, ActYaw and does not say against what.
    """
    table = _first(raw.table("MNT"))
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


def _camera_events(raw: RawLog) -> tuple[Floats, str]:
    for name in ("CAM", "TRIG"):
        table = _first(raw.table(name))
        if table is not None and ("TimeUS" in table or "TimeMS" in table):
            time = time_of(table)
            return np.unique(time[np.isfinite(time)]), name
    return np.empty(0), ""


def _utc(raw: RawLog) -> ClockFit | None:
    table = _gps(raw)
    if table is None:
        return None
    old = "Week" in table
    week, millisecond = table.floats("Week" if old else "GWk"), table.floats("TimeMS" if old else "GMS")
    utc = utc_from_gps(week, millisecond / 1000)
    good = (week > 0) & plausible_utc(utc) & (table.floats("Status") >= 2)
    return fit_clock("GPS week and milliseconds", time_of(table), np.where(good, utc, np.nan), floor_s=GPS_UTC_FLOOR_S)


def _accuracy(raw: RawLog) -> Accuracy:
    table = _first(raw.table("GPA"))
    if table is None or "HAcc" not in table:
        return Accuracy()
    horizontal, vertical = (median_of(table.floats(name), 100.0) for name in ("HAcc", "VAcc"))
    said = bool(np.isfinite([horizontal, vertical]).any())
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source="GPA" if said else "")
