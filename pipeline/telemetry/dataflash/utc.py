"""UTC out of DataFlash messages: GPS time less leap seconds."""

from __future__ import annotations

import numpy as np

from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import plausible_utc, utc_from_gps
from pipeline.telemetry.dataflash.tables import gps_in_use, time_of
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.log.tables import RawLog

GPS_UTC_FLOOR_S = 0.2
"""A receiver's message is logged when it has arrived and been parsed, 0.1 to 0.2 s after the moment it speaks of."""


def utc_clock(raw: RawLog) -> ClockModel | None:
    """UTC against log time; None where the log does not know it."""
    table = gps_in_use(raw)
    if table is None:
        return None
    old = "Week" in table
    week, millisecond = table.floats("Week" if old else "GWk"), table.floats("TimeMS" if old else "GMS")
    utc = utc_from_gps(week, millisecond / 1000)
    good = (week > 0) & plausible_utc(utc) & (table.floats("Status") >= 2)
    return fit_clock("GPS week and milliseconds", time_of(table), np.where(good, utc, np.nan), floor_s=GPS_UTC_FLOOR_S)
