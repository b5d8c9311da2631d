"""Log time of MAVLink messages, and UTC."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import believed_utc
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.vehicle import Vehicle

UNIX_US = 1e15
"""A time in microseconds above this counts from 1970, below it from boot: 1e15 us are 31 years."""
UTC_FLOOR_S = 0.05


def utc_clock(vehicle: Vehicle) -> tuple[ClockModel | None, tuple[str, ...]]:
    """UTC against log time, None where the log does not know it; and what is said of readings that are not used."""
    table = vehicle.own("SYSTEM_TIME")
    if table is None:
        return None, ()
    unix = table.floats("time_unix_usec") * 1e-6
    log = vehicle.clock.of_boot_time(table.place, table.floats("time_boot_ms") / 1000)
    utc, notes = believed_utc(table.name, log, unix)
    return fit_clock(table.name, log, utc, floor_s=UTC_FLOOR_S, set_later=True), notes


def log_time_of(vehicle: Vehicle, table: MessageTable, utc: ClockModel | None = None) -> Floats:
    """Log time (n,) of a table, by the best its messages carry."""
    arrived = vehicle.clock.of_record(table.place, table.record_time_s)
    if len(vehicle.clock.log_s) == 0:
        return arrived
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
