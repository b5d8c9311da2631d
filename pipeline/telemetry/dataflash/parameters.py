"""Parameters of the autopilot that say or change what its messages mean (PARM)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pipeline.telemetry.log.tables import RawLog

SYSTEM_NAMES = ("MAV_SYSID", "SYSID_THISMAV")
"""The vehicle's system id, by ArduPilot from 4.7 on and before."""


def parameters_of(raw: RawLog) -> Mapping[str, float]:
    """Each parameter as the log gives it last; none that is no number."""
    table = raw.table("PARM")
    if table is None:
        return {}
    told = zip(table.texts("Name"), table.floats("Value").tolist(), strict=True)
    return {name: value for name, value in told if math.isfinite(value)}


def system_of(raw: RawLog) -> int | None:
    """The vehicle's system id; None where no parameter says it."""
    value = parameters_of(raw)
    return next((int(value[name]) for name in SYSTEM_NAMES if name in value), None)
