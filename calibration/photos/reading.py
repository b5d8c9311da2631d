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
from calibration.photos.metadata import RESIZED_KEY, metadata_of

PHOTO_SUFFIXES = frozenset([".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".jp2"])
UNREAD_SUFFIXES = frozenset(
    [".heic", ".heif", ".hif", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw", ".avif",
     ".jxl", ".gif", ".insp", ".rjpeg"]
)  # fmt: skip
"""Photos that OpenCV does not read here: told, never passed over in silence."""
VIDEO_SUFFIXES = frozenset([".mp4", ".mov", ".avi", ".mkv", ".m4v", ".mts", ".m2ts", ".webm", ".mpg", ".mpeg"])

KNOWN_SUFFIXES = PHOTO_SUFFIXES | VIDEO_SUFFIXES | UNREAD_SUFFIXES
BGR_WEIGHTS = np.array([0.114, 0.587, 0.299], np.float32)
"""Of blue, green and red in gray (ITU-R BT.601), as OpenCV has them."""
STRETCH_SHARE = 0.001
"""Of the pixels that may lie outside when 16 bits or floats are brought to 8: dead and hot ones. Doubled it clips more
of a board's darkest and brightest squares, which moves no corner."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Photo:
    """A gray image (h, w) uint8 with its name and what it says about its camera."""

    name: str
    gray: cv2.typing.MatLike
    taken: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PhotoFiles:
    """What the user's sources come down to: photos and videos, each in order and once.

    unread  photos of kinds that cannot be read, of which there is no other file of that name
    """

    photos: tuple[Path, ...]
    videos: tuple[Path, ...]
    unread: tuple[Path, ...] = ()


def find_photos(sources: Sequence[Path]) -> PhotoFiles:
    """The files behind files, folders and patterns ("shots/*.jpg").

    Raises InputFileError where a source does not exist or nothing is a photo or a video.
    """
    files: dict[Path, None] = {}
    for source in sources:
        files |= dict.fromkeys(_files_of(source))
    photos = tuple(f for f in files if f.suffix.lower() in PHOTO_SUFFIXES)
    videos = tuple(f for f in files if f.suffix.lower() in VIDEO_SUFFIXES)
    read = {f.with_suffix("").resolve() for f in photos}
    unread = tuple(f for f in files if f.suffix.lower() in UNREAD_SUFFIXES and f.with_suffix("").resolve() not in read)
    if not photos and not videos:
        kinds = ", ".join(sorted({f.suffix for f in unread}))
        raise InputFileError(
            where=", ".join(map(str, sources)) or "photos",
            seen=f"only photos that cannot be read here ({kinds})" if unread else "no photos",
            expected="photos (.jpg .png .tif ...) or a video (.mp4 .mov ...) of the board",
            advice=EXPORT if unread else "name the folder that holds the photos",
        )
    return PhotoFiles(photos=photos, videos=videos, unread=unread)


EXPORT = 'export them as JPEG or TIFF in full size; a phone can be set to take JPEG ("most compatible")'


def _files_of(source: Path) -> list[Path]:
    if source.is_dir():
        return sorted(f for f in source.iterdir() if f.suffix.lower() in KNOWN_SUFFIXES and not f.name.startswith("."))
    if source.is_file():
        if source.suffix.lower() not in KNOWN_SUFFIXES:
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
    return [f for f in matched if f.suffix.lower() in KNOWN_SUFFIXES]


def read_photo(path: Path) -> Photo:
    """One photo; raises InputFileError where it is missing, cut off or no image."""
    raw = read_bytes(path, expected="a photo")
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    stored = cv2.imdecode(np.frombuffer(raw, np.uint8), flags) if raw else None
    if raw and (stored is None or stored.min() == stored.max()):
        stored = _with_channels(raw)
    if stored is None:
        kind = _unread_kind(raw)
        raise InputFileError(
            where=str(path),
            seen="an empty file" if not raw else kind or "not an image, or a damaged one",
            expected="a photo that can be decoded",
            advice=EXPORT if kind else "copy it from the camera again, or leave it out",
        )
    taken = {**_with_size(metadata_of(raw), (stored.shape[1], stored.shape[0])), "turned_deg": "0"}
    return Photo(name=path.name, gray=to_eight_bits(stored), taken=taken)


def _with_channels(raw: bytes) -> cv2.typing.MatLike | None:
    """Gray of what is not decoded as gray (colours as floats), or is drawn in the alpha channel only: over white."""
    stored = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored is None or stored.ndim < 3:
        return stored
    colours = np.asarray(stored[..., :3] if stored.shape[2] >= 3 else stored[..., :1], np.float32)
    gray = colours @ BGR_WEIGHTS if colours.shape[2] == 3 else colours[..., 0]
    if stored.shape[2] in (2, 4):
        top = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0}.get(stored.dtype, 1.0)
        share = np.asarray(stored[..., -1], np.float32) / top
        gray = share * gray + (1 - share) * top
    return np.asarray(np.rint(gray), np.uint8) if stored.dtype == np.uint8 else gray


def _with_size(said: Mapping[str, str], size: tuple[int, int]) -> dict[str, str]:
    """What a photo says, the size that its camera wrote only where the photo is of another one."""
    rest = {key: value for key, value in said.items() if not key.startswith("wrote_")}
    wrote = said.get("wrote_width", ""), said.get("wrote_height", "")
    if all(side.isdigit() and int(side) > 0 for side in wrote):
        width, height = map(int, wrote)
        if (width, height) not in (size, size[::-1]):
            rest[RESIZED_KEY] = f"{width}x{height}"
    return rest


def to_eight_bits(stored: cv2.typing.MatLike) -> cv2.typing.MatLike:
    """A gray image of 8 bits: what has more (thermal counts, 16-bit TIFF, floats) stretched over what it holds."""
    if stored.dtype == np.uint8:
        return stored
    values = np.asarray(stored, np.float32)
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return np.zeros(values.shape, np.uint8)
    low, high = np.quantile(finite, [STRETCH_SHARE, 1 - STRETCH_SHARE])
    scaled = (np.nan_to_num(values, nan=low, posinf=high, neginf=low) - low) * (255 / max(high - low, 1e-12))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), np.uint8)


def _unread_kind(raw: bytes) -> str:
    """What kind of photo it is that cannot be read, where its first bytes say so."""
    if raw[4:8] == b"ftyp":
        return f"a photo of the HEIF family ({raw[8:12].decode('latin-1').strip()}), which is not read here"
    return ""
