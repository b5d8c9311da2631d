"""Positions and heights out of DataFlash messages. Heights in POS, GPS, AHR2 are above mean sea level."""

from __future__ import annotations

import numpy as np

from pipeline.telemetry.dataflash.local_position import local_position
from pipeline.telemetry.dataflash.tables import first_instance, gps_in_use, time_of
from pipeline.telemetry.heights.undulation import Undulation, on_ellipsoid, undulation_of
from pipeline.telemetry.log.flight_log import (
    PositionSeries,
)
from pipeline.telemetry.log.series import position_series
from pipeline.telemetry.log.tables import MessageTable, RawLog

POSITION_MESSAGES = ("POS", "XKF1", "GPS", "AHR2")
"""The best first; XKF1 stands for NKF1 too."""


def vehicle_position(raw: RawLog) -> PositionSeries | None:
    """The vehicle's positions by the best message that has two valid ones; None where none has."""
    undulation = _undulation(raw)
    for name in POSITION_MESSAGES:
        if name == "XKF1":
            local = _local(raw, undulation)
            if local is not None and local.valid.sum() >= 2:
                return local
            continue
        table = gps_in_use(raw) if name == "GPS" else raw.table(name)
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
    gpa, gps = first_instance(raw.table("GPA")), gps_in_use(raw)
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
