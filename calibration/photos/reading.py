"""Photos from files, folders and patterns, one after the other, as gray images.

Pixels are taken as the sensor stored them: EXIF orientation is not applied, because a camera's lens does not turn with
the hand that holds it, and photos taken upright and on the side then agree.
"""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from calibration.photos.metadata import metadata_of

PHOTO_SUFFIXES = frozenset([".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".jp2"])
VIDEO_SUFFIXES = frozenset([".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mts", ".m2ts", ".webm", ".mpg", ".mpeg"])


@dataclass(frozen=True, kw_only=True, eq=False)
class Photo:
    """A gray image (h, w) uint8 with its name and what it says about its camera."""

    name: str
    gray: cv2.typing.MatLike
    taken: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PhotoFiles:
    """What the user's sources come down to: photos and videos, each in order and once."""

    photos: tuple[Path, ...]
    videos: tuple[Path, ...]


def find_photos(sources: Sequence[Path]) -> PhotoFiles:
    """The files behind files, folders and patterns ("shots/*.jpg").

    Raises InputFileError where a source does not exist or nothing is a photo or a video.
    """
    files: dict[Path, None] = {}
    for source in sources:
        files |= dict.fromkeys(_files_of(source))
    photos = tuple(f for f in files if f.suffix.lower() in PHOTO_SUFFIXES)
    videos = tuple(f for f in files if f.suffix.lower() in VIDEO_SUFFIXES)
    if not photos and not videos:
        raise InputFileError(
            where=", ".join(map(str, sources)) or "photos",
            seen="no photos" if not files else f"no photos among {len(files)} files",
            expected="photos (.jpg .png .tif ...) or a video (.mp4 .mov ...) of the board",
            advice="name the folder that holds the photos",
        )
    return PhotoFiles(photos=photos, videos=videos)


def _files_of(source: Path) -> list[Path]:
    if source.is_dir():
        known = PHOTO_SUFFIXES | VIDEO_SUFFIXES
        return sorted(f for f in source.iterdir() if f.suffix.lower() in known and not f.name.startswith("."))
    if source.is_file():
        if source.suffix.lower() not in PHOTO_SUFFIXES | VIDEO_SUFFIXES:
            raise InputFileError(
                where=str(source),
                seen=f"a {source.suffix or 'nameless'} file",
                expected="a photo (.jpg .png .tif ...), a video (.mp4 .mov ...) or a folder of them",
                advice="check the order of the arguments",
            )
        return [source]
    matched = sorted(Path(name) for name in glob.glob(str(source))) if glob.has_magic(str(source)) else []
    if not matched:
        raise InputFileError(
            where=str(source),
            seen="no such file or folder",
            expected="photos, a folder of photos, or a video",
            advice=f"check the name; files are looked for from {Path.cwd()}",
        )
    return [f for f in matched if f.suffix.lower() in PHOTO_SUFFIXES | VIDEO_SUFFIXES]


def read_photo(path: Path) -> Photo:
    """One photo; raises InputFileError where it is missing, cut off or no image."""
    raw = read_bytes(path, expected="a photo")
    gray = (
        cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if raw
        else None
    )
    if gray is None:
        raise InputFileError(
            where=str(path),
            seen="an empty file" if not raw else "not an image, or a damaged one",
            expected="a photo that can be decoded",
            advice="copy it from the camera again, or leave it out",
        )
    return Photo(name=path.name, gray=gray, taken={**metadata_of(raw), "turned_deg": "0"})
