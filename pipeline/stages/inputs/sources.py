"""Opening the logs and pose tables that a flight file names, each once; of a big log the minutes of the videos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.flight import AUTO, CAMERA_EVENT, CameraSettings, Flight
from pipeline.geometry.geodesy import Geodetic
from pipeline.stages.inputs.frames import video_clock
from pipeline.telemetry import (
    Excerpt,
    FlightLog,
    PoseTable,
    first_position,
    is_pose_table,
    read_log,
    read_pose_table,
)

BIG_LOG_BYTES = 1 << 26
"""A smaller log is read whole: it takes half a second."""
MARGIN_S = 60.0
"""Read of a big log before and after a video, for clocks that are refined; more where `start` is said to be uncertain
or the video is long."""
MARGIN_SIGMAS, MARGIN_SHARE = 10.0, 0.1


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
            by_path[path] = (
                read_pose_table(path)
                if table
                else read_log(path, dialect=camera.dialect, excerpts=_excerpts(flight, path), progress=tell)
            )
    found = {c.name: by_path[c.telemetry] for c in flight.cameras if c.telemetry is not None}
    logs = {name: source for name, source in found.items() if isinstance(source, FlightLog)}
    tables = {name: source for name, source in found.items() if isinstance(source, PoseTable)}
    origin = flight.origin
    if origin is None and logs:
        origin = first_position(logs.get(flight.reference_camera) or next(iter(logs.values())))
    return Sources(logs=logs, tables=tables, origin=origin)


def _excerpts(flight: Flight, log: Path) -> tuple[Excerpt, ...]:
    """The parts of a big log that the videos of its cameras need; none where that is not known before it is read."""
    if not log.exists() or log.stat().st_size < BIG_LOG_BYTES:
        return ()
    found = [_excerpt(camera) for camera in flight.cameras if camera.telemetry == log]
    known = tuple(excerpt for excerpt in found if excerpt is not None)
    return known if len(known) == len(found) else ()


def _excerpt(camera: CameraSettings) -> Excerpt | None:
    clock = video_clock(camera)
    if clock is None or camera.start is None or camera.start in (AUTO, CAMERA_EVENT):
        return None
    long_s = float(clock.time_s[-1])
    margin_s = MARGIN_S + MARGIN_SIGMAS * camera.sigma.get("start_s", 0.0) + MARGIN_SHARE * long_s
    return Excerpt(start=camera.start, before_s=margin_s, after_s=long_s + margin_s)
