"""What lies in a folder: videos, logs, tables of poses, camera files, detections; each told by what is in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from calibration.camera import CameraModel
from calibration.camera_files import read_camera
from calibration.foundation.errors import InputFileError, RunningFixError
from pipeline.export import read_detections_csv
from pipeline.telemetry import FlightLog, is_pose_table, read_log
from pipeline.tracking import VideoTimes, video_times

VIDEOS = (".mp4", ".mov", ".mkv", ".avi", ".m4v", ".ts", ".webm", ".mpg")
LOGS = (".tlog", ".mavlink", ".bin", ".log", ".ulg", ".srt")
CAMERAS = (".json", ".yaml", ".yml", ".xml", ".toml")
TABLES = (".csv", ".txt", ".parquet")
MOST_FILES = 400
"""That are looked at: a folder of a flight, not a disk."""
LARGEST_CAMERA_BYTES = 1 << 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """The files of a folder by what they are (paths relative to nothing, as they were found), and what is no use.

    videos, logs, cameras  with what was read of them; a log is None where poses come from a table
    """

    folder: Path
    videos: dict[Path, VideoTimes]
    logs: dict[Path, FlightLog | None]
    cameras: dict[Path, CameraModel]
    detections: tuple[Path, ...]
    notes: tuple[str, ...]


def look_into(folder: Path) -> Found:
    """What lies in `folder` and the folders right below it.

    Raises InputFileError where there is no such folder, or neither a video nor a table of detections in it.
    """
    if not folder.is_dir():
        raise InputFileError(
            where=str(folder),
            seen="no such folder" if not folder.exists() else "a file",
            expected="the folder with a flight's videos, logs and camera files",
            advice="check the name",
        )
    videos: dict[Path, VideoTimes] = {}
    logs: dict[Path, FlightLog | None] = {}
    cameras: dict[Path, CameraModel] = {}
    detections: list[Path] = []
    notes: list[str] = []
    for path in _files(folder):
        kind = path.suffix.lower()
        try:
            if kind in VIDEOS:
                videos[path] = video_times(path)
            elif kind in LOGS:
                logs[path] = read_log(path)
            elif kind in CAMERAS and path.stat().st_size < LARGEST_CAMERA_BYTES:
                cameras[path] = read_camera(path)
            elif kind in TABLES:
                _table(path, logs, detections)
        except RunningFixError as error:
            if kind in VIDEOS or kind in LOGS:
                notes.append(f"{path.relative_to(folder)} is left out: {error.seen}")
    if not videos and not detections:
        raise InputFileError(
            where=str(folder),
            seen="no video and no table of detections",
            expected=f"at least one ({', '.join(VIDEOS)})",
            advice="put videos, logs and camera files into one folder",
        )
    return Found(
        folder=folder, videos=videos, logs=logs, cameras=cameras, detections=tuple(detections), notes=tuple(notes)
    )


def _files(folder: Path) -> Iterator[Path]:
    """Files of a folder, then of those in it, by name; hidden ones are not looked at."""
    here = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
    count = 0
    for path in (*here, *(q for p in here if p.is_dir() for q in sorted(p.iterdir()) if not q.name.startswith("."))):
        if path.is_file():
            count += 1
            if count > MOST_FILES:
                return
            yield path


def _table(path: Path, logs: dict[Path, FlightLog | None], detections: list[Path]) -> None:
    """A table is detections, poses, or a flight record; what is none of these is not of a flight."""
    try:
        read_detections_csv(path, camera=path.stem, frame_rate=25.0, default_sigma_px=1.0)
    except RunningFixError:
        pass
    else:
        detections.append(path)
        return
    if path.suffix.lower() == ".txt":
        return
    if not is_pose_table(path):
        logs[path] = read_log(path)
    elif path.suffix.lower() == ".parquet" or _has_poses(path):
        logs[path] = None


def _has_poses(path: Path) -> bool:
    with path.open("r", errors="replace") as file:
        header = {cell.strip() for cell in file.readline(4096).split(",")}
    return {"east_m", "north_m", "up_m", "qw"} <= header
