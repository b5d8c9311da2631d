"""When the camera exposed, by DataFlash messages."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.dataflash.tables import first_instance, time_of
from pipeline.telemetry.log.tables import RawLog


def camera_events(raw: RawLog) -> tuple[Floats, str]:
    """Log times (k,) of exposures, and which message says so."""
    for name in ("CAM", "TRIG"):
        table = first_instance(raw.table(name))
        if table is not None and ("TimeUS" in table or "TimeMS" in table):
            time = time_of(table)
            return np.unique(time[np.isfinite(time)]), name
    return np.empty(0), ""
