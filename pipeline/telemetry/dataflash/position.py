"""Positions and heights out of DataFlash messages. Heights in POS, GPS, AHR2 are above mean sea level."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import median
from pipeline.geometry import rotation
from pipeline.telemetry.dataflash.local_position import lane_changes, local_position
from pipeline.telemetry.dataflash.parameters import parameters_of
from pipeline.telemetry.dataflash.tables import accuracy_in_use, gps_in_use, receivers_by_turns, time_of
from pipeline.telemetry.heights.undulation import Undulation, on_ellipsoid, told_ellipsoidal, undulation_of
from pipeline.telemetry.log.flight_log import (
    PositionSeries,
    TruthSeries,
)
from pipeline.telemetry.log.receiver import ReceiverSeries, at_times, receiver_series
from pipeline.telemetry.log.series import attitude_series, position_series
from pipeline.telemetry.log.tables import MessageTable, RawLog

POSITION_MESSAGES = ("POS", "XKF1", "GPS", "AHR2")
"""The best first; XKF1 stands for NKF1 too."""


def vehicle_undulation(raw: RawLog) -> Undulation | None:
    """What the log says of ellipsoid and mean sea level; None where it says nothing."""
    return told_ellipsoidal(parameters_of(raw).get("GPS_DRV_OPTIONS")) or _undulation(raw)


def vehicle_position(raw: RawLog, undulation: Undulation | None) -> tuple[PositionSeries | None, tuple[str, ...]]:
    """The vehicle's positions by the best message that has two valid ones, None where none has; and notes."""
    notes = () if undulation is None else undulation.notes
    for name in POSITION_MESSAGES:
        if name == "XKF1":
            local = _local(raw, undulation)
            if local is not None and local.valid.sum() >= 2:
                return local, (*notes, *_lanes(raw))
            continue
        table = gps_in_use(raw) if name == "GPS" else raw.table(name)
        if table is None:
            continue
        series = _position_of(table, undulation)
        if series.valid.sum() >= 2:
            return series, (*notes, *(receivers_by_turns(raw) if name == "GPS" else ()))
    return None, ()


def _lanes(raw: RawLog) -> tuple[str, ...]:
    turns = lane_changes(raw)
    said = f"the estimator's core that flew changed {turns} times (PI): positions are of the one in use, and step there"
    return (said,) if turns else ()


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
        above_home_m=table.floats("RelHomeAlt" if "RelHomeAlt" in table else "RelAlt"),
    )


def receiver_of(raw: RawLog, undulation: Undulation | None) -> ReceiverSeries | None:
    """The fix, accuracy and height over time of the receiver in use."""
    table, stated = gps_in_use(raw), accuracy_in_use(raw)
    if table is None:
        return None
    time, nothing = time_of(table), np.full(len(table), np.nan)
    across, up = (
        nothing if stated is None else at_times(time, time_of(stated), stated.floats(name)) for name in ("HAcc", "VAcc")
    )
    return receiver_series(
        source=table.name, time_s=time, fix=table.floats("Status"), horizontal_m=across, vertical_m=up,
        height_m=on_ellipsoid(table.floats("Alt"), undulation, table.floats("Lat"), table.floats("Lng"))[1],
    )  # fmt: skip


def simulated(raw: RawLog, undulation: Undulation | None) -> TruthSeries | None:
    """The simulator's truth: SIM, heights above mean sea level."""
    table = raw.table("SIM")
    if table is None:
        return None
    time, lat, lon = time_of(table), table.floats("Lat"), table.floats("Lng")
    roll, pitch, yaw = (np.radians(table.floats(name)) for name in ("Roll", "Pitch", "Yaw"))
    q = rotation.ned_from_frd(yaw, pitch, roll)
    return TruthSeries(
        source="SIM", time_s=time, lat_rad=np.radians(lat), lon_rad=np.radians(lon),
        height_m=on_ellipsoid(table.floats("Alt"), undulation, lat, lon)[1],
        attitude=attitude_series(source="SIM", time_s=time, ned_from_body=q),
    )  # fmt: skip


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
    gpa, gps = accuracy_in_use(raw), gps_in_use(raw)
    fixed = None if gps is None else gps.only(np.asarray(gps.floats("Status") >= 3))
    if gpa is None or fixed is None or len(fixed) == 0:
        return None
    if "Und" in gpa:
        said = gpa.floats("Und")
        difference = -said[said != 0]
        lat, lon = (np.full(len(difference), median(fixed.floats(name))) for name in ("Lat", "Lng"))
        return undulation_of("GPA.Und", difference, lat, lon)
    if "AEl" in gpa:
        near, lat, lon = (np.interp(time_of(gpa), time_of(fixed), fixed.floats(name)) for name in ("Alt", "Lat", "Lng"))
        above = gpa.floats("AEl")
        told = above != 0
        return undulation_of("GPA.AEl", (above - near)[told], lat[told], lon[told])
    return None
