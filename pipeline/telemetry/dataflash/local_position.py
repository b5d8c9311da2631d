"""Positions of ArduPilot's estimator (XKF1, NKF1): metres north, east, down of its origin (ORGN).

ArduPilot makes them of latitudes with 0.011131884502145034 m per 1e-7 degree, and of longitudes with that times the
cosine of the latitude half way (Location::offset in libraries/AP_Common/Location.cpp); so they are brought back.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, distinct
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
    cores = distinct(said[said >= 0])  # below: none yet
    if len(cores) > 1:
        return None
    core = float(cores[0]) if len(cores) else 0.0
    first = raw.table(names[0])
    if first is not None and "C" in first:
        return raw.table(names[0], lambda t: np.asarray(t.floats("C") == core))
    return raw.table(names[int(core)]) if core < len(names) else None


def by_turns(raw: RawLog, name: str, status: str) -> tuple[MessageTable | None, int]:
    """The messages of whichever core flew then, by the PI that `status` said last, and how often that changed.

    Of firmware whose messages name their core (C); None where none does, or no core is said.
    """
    table, state = raw.table(name), raw.table(status)
    if table is None or state is None or "C" not in table or "PI" not in state:
        return None, 0
    said = state.floats("PI")
    place, core = state.place[said >= 0], said[said >= 0]
    if not len(core):
        return None, 0
    flew = core[np.maximum(np.searchsorted(place, table.place, side="right") - 1, 0)]
    mine = table.only(np.asarray(table.floats("C") == flew))
    return (mine if len(mine) else None), int(np.count_nonzero(np.diff(core)))


def lane_changes(raw: RawLog) -> int:
    """How often the core that flew changed where positions are the estimator's own."""
    return max(by_turns(raw, names[0], status)[1] for names, status in LOCAL_MESSAGES)


def local_position(raw: RawLog) -> tuple[MessageTable, Floats, Floats, Floats] | None:
    """Messages, and latitude, longitude (degrees) and height above mean sea level (n,); None where there are none."""
    origin = raw.table("ORGN", lambda t: np.asarray(t.floats("Type") == EKF_ORIGIN))
    if origin is None:
        return None
    for names, status in LOCAL_MESSAGES:
        table = of_core(raw, names, status) or by_turns(raw, names[0], status)[0]
        if table is None:
            continue
        lat0, lon0, height0 = (float(origin.floats(field)[0]) for field in ("Lat", "Lng", "Alt"))
        lat = lat0 + table.floats("PN") * DEGREES_PER_M
        lon = lon0 + table.floats("PE") * DEGREES_PER_M / np.cos(np.radians((lat0 + lat) / 2))
        return table, lat, lon, height0 - table.floats("PD")
    return None
