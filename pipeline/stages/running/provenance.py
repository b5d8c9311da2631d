"""What a result was made from: the files that a flight names, versions, and whether loops were compiled."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from calibration.foundation.files import unreadable
from pipeline.flight import Flight
from pipeline.records import ImageTrack
from pipeline.solver import how_compiled

NAMED_PACKAGES = ("runningfix", "numpy", "scipy", "opencv-contrib-python-headless", "pymavlink", "pandas")


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content. Raises InputFileError where it cannot be read to its end."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(path, error, "a file that can be read to its end") from None


def tracks_hash(tracks: Iterable[ImageTrack]) -> str:
    """SHA-256 of tracks, exactly."""
    digest = hashlib.sha256()
    for track in tracks:
        digest.update(json.dumps([track.camera, track.target, len(track.frame)]).encode())
        for column in (track.frame, track.time_s, track.xy_px, track.sigma_px, track.state, track.by_box):
            digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def input_files(flight: Flight) -> dict[str, Path]:
    """Every file that a flight names, by the name it goes under in `solution.json`."""
    files = {flight.path.name: flight.path}
    for camera in flight.cameras:
        for key in ("calibration", "video", "tracks", "telemetry"):
            path = getattr(camera, key)
            if path is not None and path.exists():
                files[f"cameras.{camera.name}.{key}"] = path
    if flight.ground is not None and flight.ground.terrain is not None and flight.ground.terrain.exists():
        files["ground.terrain"] = flight.ground.terrain
    return files


def input_hashes(flight: Flight) -> dict[str, str]:
    """SHA-256 of every file that a flight names."""
    return {name: file_hash(path) for name, path in input_files(flight).items()}


def versions() -> dict[str, str]:
    """Versions of the packages that shape a result."""
    return {name: _version(name) for name in NAMED_PACKAGES}


@cache
def _version(name: str) -> str:
    """As it was when first asked: what is loaded stays what it is."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def decisive() -> dict[str, str]:
    """What decides a result's last bits beside its inputs: versions, and how loops are compiled."""
    return {**versions(), "compiled": how_compiled()}
