"""Videos of a board, and how their pictures come: size, rotation tag, shape of the pixels.

Frames are shown upright where the container has a rotation tag, as everything else that reads a video here does.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2

from calibration.foundation.errors import InputFileError
from calibration.foundation.videos import video_name
from calibration.photos.reading import Photo
from calibration.picture import Picture

MOST_FRAMES = 240
"""Frames of a video that are looked at, evenly spread."""


def video_picture(path: Path) -> Picture:
    """How the pictures of a video come. Raises InputFileError where it cannot be opened."""
    capture = _opened(path)
    found = _picture(capture)
    capture.release()
    return found


def _picture(capture: cv2.VideoCapture) -> Picture:
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
    across, down = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    aspect = across / down if across > 0 and down > 0 else 1.0
    return Picture(size=size, turned_deg=turned, sample_aspect=1 / aspect if turned % 180 else aspect)


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
    taken = {"turned_deg": str(_picture(capture).turned_deg), "sample_aspect": f"{_picture(capture).sample_aspect:g}"}
    number = given = 0
    while given < MOST_FRAMES and capture.grab():
        if number % step == 0:
            good, image = capture.retrieve()
            if good:
                given += 1
                yield Photo(name=f"{path.name}#{number}", gray=cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), taken=taken)
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
    capture = cv2.VideoCapture(video_name(path))
    if not capture.isOpened():
        raise InputFileError(
            where=str(path),
            seen="not a video, or a damaged one",
            expected="a video that can be decoded",
            advice="copy it from the camera again; a recording that was cut off has no index",
        )
    return capture
