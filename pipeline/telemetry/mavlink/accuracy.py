"""What a MAVLink log says its instruments are worth."""

from __future__ import annotations

import numpy as np

from pipeline.telemetry.log.flight_log import (
    Accuracy,
)
from pipeline.telemetry.log.series import median_of
from pipeline.telemetry.mavlink.vehicle import GPS_MESSAGES, Vehicle


def stated_accuracy(vehicle: Vehicle) -> Accuracy:
    """The sigmas that the vehicle's own messages state; NaN where they do not."""
    for name in GPS_MESSAGES:
        table = vehicle.own(name)
        if table is None or "h_acc" not in table:
            continue
        fixed = table.floats("fix_type") >= 3
        horizontal, vertical = (median_of(table.floats(f)[fixed] / 1000, 100.0) for f in ("h_acc", "v_acc"))
        yaw = table.floats("yaw")[fixed]
        dual = np.isfinite(yaw) & (yaw != 0) & (yaw != 65535)
        heading = median_of(np.radians(table.floats("hdg_acc")[fixed][dual] / 1e5), 1.0)
        if np.isfinite([horizontal, vertical]).any():
            return Accuracy(horizontal_m=horizontal, vertical_m=vertical, heading_rad=heading, source=name)
    table = vehicle.own("ESTIMATOR_STATUS")
    if table is None:
        return Accuracy()
    horizontal, vertical = (median_of(table.floats(f"pos_{axis}_accuracy"), 100.0) for axis in ("horiz", "vert"))
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source=table.name)
