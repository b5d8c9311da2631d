"""Positions of ArduPilot's estimator (XKF1, NKF1): metres north, east, down of its origin (ORGN).

ArduPilot makes them of latitudes with 0.011131884502145034 m per 1e-7 degree, and of longitudes with that times the
cosine of the latitude half way (Location::offset in libraries/AP_Common/Location.cpp); so they are brought back.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.log.tables import MessageTable, RawLog

DEGREES_PER_M = 1e-7 / 0.011131884502145034
LOCAL_MESSAGES = (("XKF1", "XKF4"), ("NKF1", "NKF4"))
"""Positions, and the messages that name the estimator's core that flew."""
EKF_ORIGIN = 0


def of_core(table: MessageTable, state: MessageTable | None) -> MessageTable | None:
    """The messages of the core that flew, by `state`'s PI; None where that changed on the way."""
    if "C" not in table:
        return table
    cores = np.unique(state.floats("PI")) if state is not None and "PI" in state else np.zeros(1)
    if len(cores) != 1:
        return None
    chosen = table.only(np.asarray(table.floats("C") == cores[0]))
    return chosen if len(chosen) else None


def local_position(raw: RawLog) -> tuple[MessageTable, Floats, Floats, Floats] | None:
    """Messages, and latitude, longitude (degrees) and height above mean sea level (n,); None where there are none."""
    origin = raw.table("ORGN", lambda t: np.asarray(t.floats("Type") == EKF_ORIGIN))
    if origin is None:
        return None
    for name, status in LOCAL_MESSAGES:
        found = raw.table(name)
        table = None if found is None else of_core(found, raw.table(status))
        if table is None:
            continue
        lat0, lon0, height0 = (float(origin.floats(field)[0]) for field in ("Lat", "Lng", "Alt"))
        lat = lat0 + table.floats("PN") * DEGREES_PER_M
        lon = lon0 + table.floats("PE") * DEGREES_PER_M / np.cos(np.radians((lat0 + lat) / 2))
        return table, lat, lon, height0 - table.floats("PD")
    return None
