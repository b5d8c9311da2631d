"""Tables of DataFlash messages: their log time, and those of one instance, receiver or estimator core.

Times are TimeUS (or TimeMS) since boot, except in GPS of old firmware, where TimeMS is the GPS week's and T the boot's.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.clocks.clock_model import settled
from pipeline.telemetry.log.tables import MessageTable, RawLog


def clock_field(table: MessageTable) -> tuple[str, float]:
    """The field that says the time since boot, and its ticks in a second; "" where none does."""
    if table.name == "GPS" and "T" in table:
        return "T", 1e3
    return next(((name, ticks) for name, ticks in (("TimeUS", 1e6), ("TimeMS", 1e3)) if name in table), ("", 1.0))


def time_of(table: MessageTable) -> Floats:
    """Log time (n,): seconds since boot; NaN where the message has none or its neighbours deny it."""
    field, ticks = clock_field(table)
    return settled(table.floats(field or "TimeMS") / ticks)


def first_instance(table: MessageTable | None) -> MessageTable | None:
    """The messages of the first instance, where messages name one."""
    if table is None:
        return None
    for name in ("I", "C"):
        instance = table.floats(name)
        if np.isfinite(instance).any():
            return table.only(np.asarray(instance == np.nanmin(instance)))
    return table


def gps_in_use(raw: RawLog) -> MessageTable | None:
    """GPS of the receiver in use (U), else of the first."""
    table = raw.table("GPS")
    if table is not None and "U" in table and (table.floats("U") == 1).any():
        return table.only(np.asarray(table.floats("U") == 1))
    return first_instance(table)


def accuracy_in_use(raw: RawLog) -> MessageTable | None:
    """GPA of the receiver in use, by the instance of most of its messages; else of the first."""
    table, gps = raw.table("GPA"), gps_in_use(raw)
    if table is not None and gps is not None and "I" in table and "I" in gps:
        mine = table.only(np.asarray(table.floats("I") == np.median(gps.floats("I"))))
        if len(mine):
            return mine
    return first_instance(table)
