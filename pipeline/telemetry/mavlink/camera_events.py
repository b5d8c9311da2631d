"""When the camera exposed, by MAVLink messages."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, whole_numbers
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.times import log_time_of
from pipeline.telemetry.mavlink.vehicle import Vehicle

CAMERA_FIELDS = {"CAMERA_IMAGE_CAPTURED": "camera_id", "CAMERA_FEEDBACK": "cam_idx"}
"""Which of several cameras of one component a message is about."""


def camera_events(vehicle: Vehicle, utc: ClockModel | None) -> tuple[Floats, str, list[str]]:
    """Log times (k,) of exposures of one camera, which message says so, and notes."""
    for name in ("CAMERA_IMAGE_CAPTURED", "CAMERA_FEEDBACK", "CAMERA_TRIGGER"):
        table = vehicle.any(name)
        if table is None:
            continue
        if name == "CAMERA_IMAGE_CAPTURED":
            table = table.only(np.asarray(table.floats("capture_result") == 1))
        if not len(table):
            continue
        table, notes = _one_camera(table)
        time = log_time_of(vehicle, table, utc)
        time = np.unique(time[np.isfinite(time)])
        if len(time):
            return time, name, notes
    return np.empty(0), "", []


def _one_camera(table: MessageTable) -> tuple[MessageTable, list[str]]:
    """The messages of the camera that speaks most, and what to say where others do."""
    number = whole_numbers(table.floats(CAMERA_FIELDS.get(table.name, ""))) & 255
    which = table.component.astype(np.int64) << 8 | number
    many = np.bincount(which)
    best, kinds = int(many.argmax()), int(np.count_nonzero(many))
    if kinds == 1:
        return table, []
    said = f"{kinds} cameras speak in {table.name}; component {best >> 8}, camera {best & 255} is used"
    return table.only(which == best), [said]
