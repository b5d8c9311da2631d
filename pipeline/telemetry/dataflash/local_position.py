"""Positions of ArduPilot's estimator (XKF1, NKF1): metres north, east, down of its origin (ORGN).

ArduPilot makes them of latitudes with 0.011131884502145034 m per 1e-7 degree, and of longitudes with that times the
cosine of the latitude half way (Location::offset in libraries/AP_Common/Location.cpp); so they are brought back.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.log.tables import MessageTable, RawLog

DEGREES_PER_M = 1e-7 / 0.011131884502145034
LOCAL_MESSAGES = ((("XKF1", "XKF6"), "XKF4"), (("NKF1", "NKF6"), "NKF4"))
"""Positions of each core where its number is no field (C), and the messages that name the core that flew (PI)."""
EKF_ORIGIN = 0


def of_core(raw: RawLog, names: tuple[str, ...], status: str) -> MessageTable | None:
    """The messages of the core that flew, by the PI of `status`; None where there are none, or that changed on the way.

    Firmware before 4.1 has a message of its own for each core: `names`.
    """
    state = raw.table(status)
    said = state.floats("PI") if state is not None and "PI" in state else np.zeros(1)
    cores = np.unique(said[said >= 0])  # below: none yet
    if len(cores) > 1:
        return None
    core = float(cores[0]) if len(cores) else 0.0
    first = raw.table(names[0])
    if first is not None and "C" in first:
        return raw.table(names[0], lambda t: np.asarray(t.floats("C") == core))
    return raw.table(names[int(core)]) if core < len(names) else None


def local_position(raw: RawLog) -> tuple[MessageTable, Floats, Floats, Floats] | None:
    """Messages, and latitude, longitude (degrees) and height above mean sea level (n,); None where there are none."""
    origin = raw.table("ORGN", lambda t: np.asarray(t.floats("Type") == EKF_ORIGIN))
    if origin is None:
        return None
    for names, status in LOCAL_MESSAGES:
        table = of_core(raw, names, status)
        if table is None:
            continue
        lat0, lon0, height0 = (float(origin.floats(field)[0]) for field in ("Lat", "Lng", "Alt"))
        lat = lat0 + table.floats("PN") * DEGREES_PER_M
        lon = lon0 + table.floats("PE") * DEGREES_PER_M / np.cos(np.radians((lat0 + lat) / 2))
        return table, lat, lon, height0 - table.floats("PD")
    return None
