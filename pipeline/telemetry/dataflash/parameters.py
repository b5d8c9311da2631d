"""Parameters of the autopilot that say or change what its messages mean (PARM)."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.telemetry.log.tables import RawLog

SYSTEM_NAMES = ("MAV_SYSID", "SYSID_THISMAV")
"""The vehicle's system id, by ArduPilot from 4.7 on and before."""


def parameters_of(raw: RawLog) -> Mapping[str, float]:
    """Each parameter as the log gives it last."""
    table = raw.table("PARM")
    if table is None:
        return {}
    names = [name.decode("ascii", "replace") for name in table.columns["Name"].tolist()]
    return dict(zip(names, table.floats("Value").tolist(), strict=True))


def system_of(raw: RawLog) -> int | None:
    """The vehicle's system id; None where no parameter says it."""
    value = parameters_of(raw)
    return next((int(value[name]) for name in SYSTEM_NAMES if name in value), None)
