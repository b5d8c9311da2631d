"""The vehicle's attitude out of DataFlash messages.

Quaternions (XKQ, NKQ1) turn the autopilot's axes, so the board's trim is taken out of them: ned_from_body =
ned_from_board * board_from_body(-trim); ATT already has it out.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.telemetry.dataflash.local_position import of_core
from pipeline.telemetry.dataflash.parameters import parameters_of
from pipeline.telemetry.dataflash.tables import time_of
from pipeline.telemetry.log.flight_log import (
    AttitudeSeries,
)
from pipeline.telemetry.log.series import attitude_series, denser
from pipeline.telemetry.log.tables import MessageTable, RawLog

CORE_MESSAGES = ((("XKQ",), "XKF4"), (("NKQ",), "NKF4"), (("NKQ1", "NKQ2"), "NKF4"), (("XKQ1", "XKQ2"), "XKF4"))
TRIM_NAMES = ("AHRS_TRIM_X", "AHRS_TRIM_Y", "AHRS_TRIM_Z")


def vehicle_attitude(raw: RawLog) -> AttitudeSeries | None:
    """The vehicle's attitudes, of its second estimator (AHR2) where there are no others; None without any."""
    exact = primary_core(raw)
    table = denser(exact, raw.table("ATT")) or raw.table("AHR2")
    if table is None:
        return None
    if table.name in ("ATT", "AHR2"):
        q = rotation.ned_from_frd(*np.radians([table.floats(angle) for angle in ("Yaw", "Pitch", "Roll")]))
    else:
        board = np.stack([table.floats(f"Q{i}") for i in (1, 2, 3, 4)], axis=1)
        q = rotation.multiply(board, rotation.exp(-_trim(raw)))
    return attitude_series(source=table.name, time_s=time_of(table), ned_from_body=q)


def primary_core(raw: RawLog) -> MessageTable | None:
    """Quaternions of the estimator's core that flew, if it was the same one all the time."""
    found = (of_core(raw, names, status) for names, status in CORE_MESSAGES)
    return next((table for table in found if table is not None), None)


def _trim(raw: RawLog) -> Floats:
    """The board's trim (3,) roll, pitch, yaw in radians, as the parameters give it last."""
    value = parameters_of(raw)
    return np.array([value.get(name, 0.0) for name in TRIM_NAMES])
