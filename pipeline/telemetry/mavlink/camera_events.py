"""When the camera exposed, by MAVLink messages."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import Vehicle


def camera_events(vehicle: Vehicle, utc: ClockModel | None) -> tuple[Floats, str]:
    """Log times (k,) of exposures, and which message says so."""
    for name in ("CAMERA_IMAGE_CAPTURED", "CAMERA_FEEDBACK", "CAMERA_TRIGGER"):
        table = vehicle.any(name)
        if table is None:
            continue
        if name == "CAMERA_IMAGE_CAPTURED":
            table = table.only(np.asarray(table.floats("capture_result") == 1))
        time = log_time_of(vehicle, table, utc)
        time = np.unique(time[np.isfinite(time)])
        if len(time):
            return time, name
    return np.empty(0), ""
