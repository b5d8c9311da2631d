"""Photos from files, folders, patterns and videos, one after the other, as gray images.

Pixels are taken as the sensor stored them: EXIF orientation and a video's rotation tag are not applied, because a
camera's lens does not turn with the hand that holds it, and photos taken upright and on the side then agree.
"""

from __future__ import annotations

import glob
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from calibration.photos.metadata import metadata_of

PHOTO_SUFFIXES = frozenset([".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".jp2"])
VIDEO_SUFFIXES = frozenset([".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mts", ".m2ts", ".webm", ".mpg", ".mpeg"])
MOST_FRAMES = 240
"""Frames of a video that are looked at, evenly spread."""


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
    return Photo(name=path.name, gray=gray, taken=metadata_of(raw))


def frame_count(path: Path) -> int:
    """How many frames of a video are looked at."""
    capture = _opened(path)
    total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    capture.release()
    return min(total, MOST_FRAMES) if total > 0 else MOST_FRAMES


def video_frames(path: Path) -> Iterator[Photo]:
    """At most 240 frames spread evenly over a video, named by file and frame number.

    Raises InputFileError where it cannot be opened or holds no frame.
    """
    capture = _opened(path)
    total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    step = max(1, total // MOST_FRAMES)
    number = given = 0
    while given < MOST_FRAMES and capture.grab():
        if number % step == 0:
            good, image = capture.retrieve()
            if good:
                given += 1
                yield Photo(name=f"{path.name}#{number}", gray=cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        number += 1
    capture.release()
    if not given:
        raise InputFileError(
            where=str(path),
            seen="no frame could be decoded",
            expected="a whole video",
            advice="copy the video from the camera again",
        )


def _opened(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    if not capture.isOpened():
        raise InputFileError(
            where=str(path),
            seen="not a video, or a damaged one",
            expected="a video that can be decoded",
            advice="copy it from the camera again; a recording that was cut off has no index",
        )
    return capture
