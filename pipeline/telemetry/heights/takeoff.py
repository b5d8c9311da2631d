"""Heights above the take-off place, brought to the ellipsoid by how high that place is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.errors import UsageError
from pipeline.telemetry.heights.geoid import geoid_height_m, geoid_name
from pipeline.telemetry.log.flight_log import FlightLog


def with_takeoff(log: FlightLog, height_m: float, *, above_sea: bool, where: str) -> FlightLog:
    """The log with heights by its own heights above home and a take-off place at `height_m`.

    `above_sea`: above mean sea level (the geoid brings it to the ellipsoid), else above the ellipsoid. `where` names
    file and key. Raises UsageError where the log gives no heights above home.
    """
    position = log.position
    if position is None or not np.isfinite(position.above_home_m[position.valid]).any():
        raise UsageError(
            where=where,
            seen=f"a take-off height, but {log.path.name} gives no heights above home",
            expected="a log with heights above home (subtitles, GLOBAL_POSITION_INT, POS)",
            advice="leave `takeoff` out: the log's own heights are used then",
        )
    first = int(np.flatnonzero(position.valid)[0])
    geoid = geoid_height_m(position.lat_rad[[first]], position.lon_rad[[first]])[0] if above_sea else 0.0
    words = f"above home + a take-off place at {height_m:.1f} m"
    words += (
        f" above mean sea level + {geoid:.2f} m undulation by {geoid_name()}" if above_sea else " above the ellipsoid"
    )
    raised = replace(position, height_m=position.above_home_m + height_m + geoid, datum="ellipsoid", height_from=words)
    notes = tuple(note for note in log.notes if not note.startswith(HOME_NOTE))
    return replace(log, position=raised, takeoff_given=True, notes=notes)


HOME_NOTE = "heights are above the take-off place"
"""How every note begins that asks for `takeoff`."""
