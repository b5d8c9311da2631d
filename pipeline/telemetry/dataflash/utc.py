"""UTC out of DataFlash messages: GPS time less leap seconds."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import believed_utc, plausible_utc, utc_from_gps
from pipeline.telemetry.dataflash.tables import gps_in_use, time_of
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.log.tables import MessageTable, RawLog

GPS_UTC_FLOOR_S = 0.2
"""A receiver's message is logged when it has arrived and been parsed, 0.1 to 0.2 s after the moment it speaks of."""


SOURCE = "GPS week and milliseconds"


def utc_clock(raw: RawLog) -> tuple[ClockModel | None, tuple[str, ...]]:
    """UTC against log time, None where the log does not know it; and what is said of readings that are not used."""
    table, time, said = _readings(raw)
    if table is None:
        return None, ()
    utc, notes = believed_utc(SOURCE, time, said)
    return fit_clock(SOURCE, time, utc, floor_s=GPS_UTC_FLOOR_S, set_later=True), notes


def utc_readings(raw: RawLog) -> tuple[MessageTable | None, Floats, Floats]:
    """Messages of the receiver in use, their log times (n,) and UTC (n,), NaN where there is no fix or it cannot be."""
    table, time, utc = _readings(raw)
    return table, time, np.where(plausible_utc(utc), utc, np.nan)


def _readings(raw: RawLog) -> tuple[MessageTable | None, Floats, Floats]:
    """The same with every date, also one that cannot be a flight's."""
    table = gps_in_use(raw)
    if table is None:
        return None, np.empty(0), np.empty(0)
    old = "Week" in table
    week, millisecond = table.floats("Week" if old else "GWk"), table.floats("TimeMS" if old else "GMS")
    utc = utc_from_gps(week, millisecond / 1000)
    good = (week > 0) & (table.floats("Status") >= 2)
    return table, time_of(table), np.where(good, utc, np.nan)
