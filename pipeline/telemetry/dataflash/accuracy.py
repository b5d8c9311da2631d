"""What a DataFlash log says its instruments are worth."""

from __future__ import annotations

import numpy as np

from pipeline.telemetry.dataflash.tables import accuracy_in_use
from pipeline.telemetry.log.flight_log import (
    Accuracy,
)
from pipeline.telemetry.log.series import median_of
from pipeline.telemetry.log.tables import RawLog


def stated_accuracy(raw: RawLog) -> Accuracy:
    """The sigmas that the log states; NaN where it does not."""
    table = accuracy_in_use(raw)
    if table is None or "HAcc" not in table:
        return Accuracy()
    horizontal, vertical = (median_of(table.floats(name), 100.0) for name in ("HAcc", "VAcc"))
    said = bool(np.isfinite([horizontal, vertical]).any())
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source="GPA" if said else "")
