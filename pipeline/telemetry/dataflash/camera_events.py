"""When the camera exposed, by DataFlash messages."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, distinct
from pipeline.telemetry.dataflash.tables import first_instance, time_of
from pipeline.telemetry.log.tables import RawLog


def camera_events(raw: RawLog) -> tuple[Floats, str, tuple[str, ...]]:
    """Log times (k,) of exposures of one camera, which message says so, and notes."""
    for name in ("CAM", "TRIG"):
        table, cameras = first_instance(raw.table(name))
        if table is not None and ("TimeUS" in table or "TimeMS" in table):
            time = time_of(table)
            which = "" if cameras < 2 else f"{cameras} cameras speak in {name}; instance {table.floats('I')[0]:.0f}"
            return distinct(time[np.isfinite(time)]), name, (f"{which} is used",) if which else ()
    return np.empty(0), "", ()
