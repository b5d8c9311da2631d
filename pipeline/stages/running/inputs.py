"""What is looked at before anything long begins: every file that a flight names, and the folder that results go to."""

from __future__ import annotations

import re
from pathlib import Path

from calibration.camera import CameraModel
from calibration.foundation.errors import InputFileError, UsageError
from calibration.foundation.files import check_regular
from pipeline.export import EXPORTS
from pipeline.flight import Flight
from pipeline.stages.inputs.cameras import read_models
from pipeline.stages.running.provenance import input_files

FILE_KEYS = ("calibration", "video", "tracks", "telemetry")
WRITTEN = re.compile(
    "|".join(re.escape(n) for n in ("tracks.csv", "poses.csv", "report.html", *(e.file_name for e in EXPORTS)))
    + r"|trajectory-.*\.(tum|waypoints)|overlay-.*\.mp4"
)


def check_inputs(flight: Flight, out: Path, *, cameras_later: bool = False) -> dict[str, CameraModel]:
    """Looks at every input that is quickly looked at, so that a long run does not fail at its end; the cameras.

    With `cameras_later` a camera that is not calibrated yet is left out: tracking needs none.

    Raises InputFileError where a file is missing or a camera file is wrong, UsageError where results would be written
    over an input.
    """
    check_files(flight, cameras_later=cameras_later)
    for path in input_files(flight).values():
        if WRITTEN.fullmatch(path.name) and path.resolve().parent == out.resolve():
            raise UsageError(
                where="-o",
                seen=f"{out}, where the flight's own {path.name} is",
                expected="a folder in which results write over no input",
                advice="choose another -o folder",
            )
    return read_models(flight, left_out=not_calibrated(flight) if cameras_later else ())


def not_calibrated(flight: Flight) -> tuple[str, ...]:
    """The cameras whose camera file does not exist yet."""
    return tuple(camera.name for camera in flight.cameras if not camera.calibration.exists())


def check_files(flight: Flight, *, cameras_later: bool = False) -> None:
    """Raises InputFileError where a file that the flight names is missing, or is none."""
    for camera in flight.cameras:
        for key in FILE_KEYS:
            path: Path | None = getattr(camera, key)
            if path is not None and not (cameras_later and key == "calibration" and not path.exists()):
                _check_file(flight, f"cameras.{camera.name}", key, path)
    if flight.ground is not None and flight.ground.terrain is not None:
        _check_file(flight, "ground", "terrain", flight.ground.terrain)


def _check_file(flight: Flight, table: str, key: str, path: Path) -> None:
    expected = f"what {table}.{key} in {flight.path} names"
    if not path.exists():
        photos = "make it with `runningfix calibrate`" if key == "calibration" else "check the name"
        raise InputFileError(
            where=str(path),
            seen="no such file",
            expected=expected,
            advice=f"{photos}; paths are relative to the flight file",
        )
    check_regular(path, expected=expected)
