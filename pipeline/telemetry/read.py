"""Read any flight log: the file's kind is told by its first bytes and its name."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import InputFileError
from pipeline.telemetry.flight_log import FlightLog
from pipeline.telemetry.mavlink_plain import read_mavlink_plain
from pipeline.telemetry.mavlink_poses import mavlink_flight
from pipeline.telemetry.tables import Progress

KNOWN = ".tlog, .mavlink"


def read_log(path: Path, *, system: int | None = None, progress: Progress = None) -> FlightLog:
    """The flight log at `path`.

    `system` picks one vehicle of a MAVLink link by its system id. `progress` is called with the share done, 0 to 1.

    Raises InputFileError where the file is missing, of no known kind, or holds no vehicle.
    """
    kind = path.suffix.lower()
    if kind in (".tlog", ".mavlink"):
        return mavlink_flight(read_mavlink_plain(path, progress=progress), system=system)
    raise InputFileError(
        where=str(path),
        seen=f"a file named {kind or 'without ending'}",
        expected=f"a flight log: {KNOWN}",
        advice="convert it, or give the camera's poses as a .csv",
    )
