"""Opening the logs and pose tables that a flight file names, each once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.flight import Flight
from pipeline.geometry.geodesy import Geodetic
from pipeline.telemetry import FlightLog, PoseTable, first_position, is_pose_table, read_log, read_pose_table


@dataclass(frozen=True, kw_only=True, eq=False)
class Sources:
    """The opened logs and tables of a flight, by camera, and the origin of its ENU frame."""

    logs: Mapping[str, FlightLog]
    tables: Mapping[str, PoseTable]
    origin: Geodetic | None


def open_sources(flight: Flight, progress: Callable[[str, float], None] | None = None) -> Sources:
    """Reads every log and pose table once; the same file for two cameras is read once."""
    by_path: dict[Path, FlightLog | PoseTable] = {}
    for camera in flight.cameras:
        path = camera.telemetry
        if path is not None and path not in by_path:
            name = camera.name
            tell = None if progress is None else (lambda share, name=name: progress(name, share))
            table = is_pose_table(path)
            by_path[path] = read_pose_table(path) if table else read_log(path, dialect=camera.dialect, progress=tell)
    found = {c.name: by_path[c.telemetry] for c in flight.cameras if c.telemetry is not None}
    logs = {name: source for name, source in found.items() if isinstance(source, FlightLog)}
    tables = {name: source for name, source in found.items() if isinstance(source, PoseTable)}
    origin = flight.origin
    if origin is None and logs:
        origin = first_position(logs.get(flight.reference_camera) or next(iter(logs.values())))
    return Sources(logs=logs, tables=tables, origin=origin)
