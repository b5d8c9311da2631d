"""Opening the logs and pose tables that a flight file names, each once; of a big log the minutes of the videos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.flight import AUTO, CAMERA_EVENT, CameraSettings, Flight
from pipeline.geometry.geodesy import Geodetic
from pipeline.stages.inputs.frames import video_clock
from pipeline.stages.inputs.whose import check_datums, check_vehicles, left_over
from pipeline.telemetry import (
    Excerpt,
    FlightLog,
    PoseTable,
    first_position,
    is_pose_table,
    read_log,
    read_pose_table,
    with_takeoff,
)

BIG_LOG_BYTES = 1 << 26
"""A smaller log is read whole: it takes half a second."""
MARGIN_S = 60.0
"""Read of a big log before and after a video, for clocks that are refined; more where `start` is said to be uncertain
or the video is long."""
MARGIN_SIGMAS, MARGIN_SHARE = 10.0, 0.1


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """What a camera asks of a file."""

    path: Path
    system: int | None = None
    gimbal: int | None = None
    dialect: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sources:
    """The opened logs and tables of a flight, by camera, and the origin of its ENU frame."""

    logs: Mapping[str, FlightLog]
    tables: Mapping[str, PoseTable]
    origin: Geodetic | None


def open_sources(flight: Flight, progress: Callable[[str, float], None] | None = None) -> Sources:
    """Reads every log and pose table once; what two cameras ask of the same file is read once.

    Raises UsageError where it is not clear which vehicle or gimbal of a log a camera is on, where two cameras come to
    one vehicle unasked, and where heights of two datums would meet.
    """
    opened: dict[_Asked, FlightLog | PoseTable] = {}
    found: dict[str, FlightLog | PoseTable] = {}
    for camera in flight.cameras:
        if camera.telemetry is not None:
            tell = None if progress is None else (lambda share, name=camera.name: progress(name, share))
            found[camera.name] = _open(flight, camera, opened, tell)
    logs = {name: source for name, source in found.items() if isinstance(source, FlightLog)}
    tables = {name: source for name, source in found.items() if isinstance(source, PoseTable)}
    check_vehicles(flight, logs)
    logs = {name: _raised(flight, flight.camera(name), log) for name, log in logs.items()}
    check_datums(flight, logs)
    origin = flight.origin
    if origin is None and logs:
        origin = first_position(logs.get(flight.reference_camera) or next(iter(logs.values())))
    return Sources(logs=logs, tables=tables, origin=origin)


def _open(
    flight: Flight,
    camera: CameraSettings,
    opened: dict[_Asked, FlightLog | PoseTable],
    tell: Callable[[float], None] | None,
) -> FlightLog | PoseTable:
    path = camera.telemetry
    assert path is not None
    if is_pose_table(path):
        asked = _Asked(path=path)
        if asked not in opened:
            opened[asked] = read_pose_table(path)
        return opened[asked]
    gimbal = camera.gimbal if camera.mount.gimbal else None
    asked = _Asked(path=path, system=camera.system, gimbal=gimbal, dialect=camera.dialect)
    if asked not in opened:
        opened[asked] = _read(flight, asked, tell)
    log = opened[asked]
    assert isinstance(log, FlightLog)
    if camera.system is None and len(log.systems) > 1:
        asked = replace(asked, system=left_over(flight, camera, log))
        if asked not in opened:
            opened[asked] = _read(flight, asked, tell)
    return opened[asked]


def _read(flight: Flight, asked: _Asked, tell: Callable[[float], None] | None) -> FlightLog:
    return read_log(
        asked.path,
        system=asked.system,
        gimbal=asked.gimbal,
        dialect=asked.dialect,
        excerpts=_excerpts(flight, asked.path),
        progress=tell,
    )


def _raised(flight: Flight, camera: CameraSettings, log: FlightLog) -> FlightLog:
    takeoff = camera.takeoff
    if takeoff is None:
        return log
    where = flight.key(camera.name, "takeoff")
    return with_takeoff(log, takeoff.height_m, above_sea=takeoff.datum == "msl", where=where)


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
