"""Videos of a board, and how their pictures come: size, rotation tag, shape of the pixels.

Frames are shown upright where the container has a rotation tag, as everything else that reads a video here does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2

from calibration.foundation.capture import Capture, VideoHead, no_frames
from calibration.photos.reading import Photo
from calibration.photos.video_metadata import said_by_video
from calibration.picture import Picture

MOST_FRAMES = 240
"""Frames of a video that are looked at, evenly spread."""


def video_picture(path: Path, stream: int | None = None) -> Picture:
    """How the pictures of a video come. Raises InputFileError where it cannot be opened."""
    capture = Capture(path, stream=stream)
    try:
        return replace(_picture(capture.head()), said=said_by_video(path))
    finally:
        capture.close()


def _picture(head: VideoHead) -> Picture:
    return Picture(size=head.image_size, turned_deg=head.turned_deg, sample_aspect=head.sample_aspect)


def frame_count(path: Path) -> int:
    """How many frames of a video are looked at."""
    capture = Capture(path)
    try:
        return min(len(capture.index().stamp_s), MOST_FRAMES)
    finally:
        capture.close()


def video_frames(path: Path) -> Iterator[Photo]:
    """At most 240 frames spread evenly over a video, named by file and frame number; damaged ones are left out.

    Raises InputFileError where it cannot be opened or holds no frame.
    """
    capture = Capture(path)
    try:
        picture, total = _picture(capture.head()), len(capture.index().stamp_s)
        step = max(1, total // MOST_FRAMES)
        taken = {
            **said_by_video(path),
            "turned_deg": str(picture.turned_deg),
            "sample_aspect": f"{picture.sample_aspect:g}",
        }
        given = 0
        for shot in capture.shots():
            if shot.number % step == 0 and not shot.damaged and given < MOST_FRAMES:
                given += 1
                gray = cv2.cvtColor(capture.pixels(shot), cv2.COLOR_BGR2GRAY)
                yield Photo(name=f"{path.name}#{shot.number}", gray=gray, taken=taken)
    finally:
        capture.close()
    if not given:
        raise no_frames(path)
