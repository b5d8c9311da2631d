"""Positions and heights out of MAVLink messages.

GLOBAL_POSITION_INT and the GPS messages give 1e-7 degrees and millimetres above mean sea level.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.telemetry.heights.undulation import Undulation, on_ellipsoid, told_ellipsoidal, undulation_of
from pipeline.telemetry.log.flight_log import (
    PositionSeries,
    TruthSeries,
)
from pipeline.telemetry.log.receiver import FIX_3D, ReceiverSeries, receiver_series
from pipeline.telemetry.log.series import attitude_series, position_series
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import GPS_MESSAGES, POSITION_MESSAGES, Vehicle


def vehicle_undulation(vehicle: Vehicle) -> Undulation | None:
    """What the log says of ellipsoid and mean sea level; None where it says nothing."""
    return told_ellipsoidal(vehicle.parameter("GPS_DRV_OPTIONS")) or _undulation(vehicle)


def vehicle_position(vehicle: Vehicle, undulation: Undulation | None) -> tuple[PositionSeries | None, tuple[str, ...]]:
    """The vehicle's positions by the best message that has two valid ones, None where none has; and notes."""
    for name in POSITION_MESSAGES:
        table = vehicle.own(name)
        if table is not None:
            series = _position_of(vehicle, table, undulation)
            if series.valid.sum() >= 2:
                return series, () if undulation is None else undulation.notes
    return None, ()


def _position_of(vehicle: Vehicle, table: MessageTable, undulation: Undulation | None) -> PositionSeries:
    lat, lon = table.floats("lat"), table.floats("lng" if table.name == "AHRS2" else "lon")
    height = table.floats("altitude") if table.name == "AHRS2" else table.floats("alt") / 1000
    bad = (lat == 0) & (lon == 0)
    if table.name in GPS_MESSAGES:
        bad |= table.floats("fix_type") < 3
    lat_deg, lon_deg = (np.where(bad, np.nan, angle / 1e7) for angle in (lat, lon))
    words, height = on_ellipsoid(height, undulation, lat_deg, lon_deg)
    if table.name in GPS_MESSAGES and "alt_ellipsoid" in table and undulation is not None and undulation.believed:
        own = table.floats("alt_ellipsoid")
        height = np.where(own != 0, own / 1000, height)
    return position_series(
        source=table.name,
        datum="ellipsoid",
        height_from=words,
        time_s=log_time_of(vehicle, table),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=np.where(bad, np.nan, height),
        velocity_ned_mps=_velocity(table),
        above_home_m=table.floats("relative_alt") / 1000,
    )


def receiver_of(vehicle: Vehicle, undulation: Undulation | None) -> ReceiverSeries | None:
    """The receiver's fix, accuracy and height over time: of the first that ever has a 3D fix, else of the first."""
    every = [found for name in GPS_MESSAGES if (found := vehicle.own(name)) is not None]
    if not every:
        return None
    table = next((one for one in every if (one.floats("fix_type") >= FIX_3D).any()), every[0])
    lat, lon = table.floats("lat") / 1e7, table.floats("lon") / 1e7
    across, up = (table.floats(name) / 1000 for name in ("h_acc", "v_acc"))
    return receiver_series(
        source=table.name, time_s=log_time_of(vehicle, table), fix=table.floats("fix_type"), horizontal_m=across,
        vertical_m=up, height_m=on_ellipsoid(table.floats("alt") / 1000, undulation, lat, lon)[1],
    )  # fmt: skip


def simulated(vehicle: Vehicle) -> TruthSeries | None:
    """The simulator's truth: SIMSTATE, which has no height and no time but that of its arrival."""
    table = vehicle.own("SIMSTATE")
    if table is None:
        return None
    time = log_time_of(vehicle, table)
    lat, lon = (np.radians(table.floats(name) / 1e7) for name in ("lat", "lng"))
    q = rotation.ned_from_frd(*(table.floats(name) for name in ("yaw", "pitch", "roll")))
    return TruthSeries(
        source="SIMSTATE", time_s=time, lat_rad=lat, lon_rad=lon, height_m=np.full(len(table), np.nan),
        attitude=attitude_series(source="SIMSTATE", time_s=time, ned_from_body=q),
    )  # fmt: skip


def _velocity(table: MessageTable) -> Floats:
    if table.name == "GLOBAL_POSITION_INT":
        return np.stack([table.floats(axis) / 100 for axis in ("vx", "vy", "vz")], axis=1)
    return np.full((len(table), 3), np.nan)


def _undulation(vehicle: Vehicle) -> Undulation | None:
    """Ellipsoid minus mean sea level, from the receiver that gives both."""
    for name in GPS_MESSAGES:
        table = vehicle.own(name)
        if table is None or "alt_ellipsoid" not in table:
            continue
        both = (table.floats("alt_ellipsoid") != 0) & (table.floats("fix_type") >= 3)
        difference = table.floats("alt_ellipsoid")[both] / 1000 - table.floats("alt")[both] / 1000
        found = undulation_of(name, difference, table.floats("lat")[both] / 1e7, table.floats("lon")[both] / 1e7)
        if found is not None:
            return found
    return None
