"""Video in: frames in order with the container's own times, decoded ahead of whoever uses them.

A frame's time is the presentation timestamp, read after the frame was (before, it is the previous frame's), and
counted from frame 0. Containers that say how they are rotated are shown upright.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.errors import InputFileError
from pipeline.tracking.ahead import ahead
from pipeline.tracking.records import VideoTimes

Image = npt.NDArray[np.uint8]
AHEAD = 6  # frames decoded in advance


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One decoded frame: its number, its time from frame 0, its pixels (h, w, 3) BGR."""

    index: int
    time_s: float
    pixels: Image


@dataclass(frozen=True, kw_only=True)
class VideoHead:
    """What a container says of itself; `frames` is a claim, not a count."""

    frame_rate: float
    image_size: tuple[int, int]
    frames: int


def video_times(path: Path) -> VideoTimes:
    """The times of every frame, from the container's packets: nothing is decoded.

    Raises InputFileError where there is no video or no frame in it.
    """
    head = video_head(path)  # of the upright picture; the packets know nothing of rotation
    capture = opened(path, [cv2.CAP_PROP_FORMAT, -1])
    stamps: list[float] = []
    while capture.grab():
        stamps.append(capture.get(cv2.CAP_PROP_POS_MSEC))
    capture.release()
    if not stamps:
        raise _no_frames(path)
    time_s = np.sort(np.asarray(stamps)) * 1e-3
    return VideoTimes(
        frame_time_s=_sane(time_s - time_s[0], head.frame_rate), frame_rate=head.frame_rate, image_size=head.image_size
    )


def video_head(path: Path) -> VideoHead:
    """Frame rate, size and claimed length.

    Raises InputFileError where there is no video.
    """
    capture = opened(path)
    head = _head(capture, path)
    capture.release()
    return head


def frames_of(path: Path) -> Iterator[Frame]:
    """Every frame that decodes, in order; a thread decodes ahead, memory is constant.

    Raises InputFileError where there is no video or not a single frame.
    """
    yield from ahead(_decoded(path), AHEAD)


def first_stamp_s(path: Path) -> float:
    """The container's own time of the first frame.

    Raises InputFileError where there is no video.
    """
    capture = opened(path)
    capture.grab()
    stamp = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
    capture.release()
    return float(stamp)


def _decoded(path: Path) -> Iterator[Frame]:
    capture = opened(path)
    try:
        rate = _head(capture, path).frame_rate
        index, first, last = 0, 0.0, -1.0
        while (read := capture.read())[0]:
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            first = stamp if index == 0 else first
            time_s = stamp - first
            if index and time_s <= last:  # a container without times
                time_s = last + 1.0 / rate
            yield Frame(index=index, time_s=time_s, pixels=np.asarray(read[1], np.uint8))
            index, last = index + 1, time_s
    finally:
        capture.release()
    if index == 0:
        raise _no_frames(path)


def opened(path: Path, parameters: list[int] | None = None) -> cv2.VideoCapture:
    """The video, opened and silent.

    Raises InputFileError where it is none.
    """
    if not path.is_file():
        raise InputFileError(
            where=str(path),
            seen="no such file" if not path.exists() else "not a file",
            expected="a video",
            advice=f"check the name; files are looked for from {path.parent.resolve()}",
        )
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's own complaints; ours say more
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_ERROR)
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, parameters or [])
    logging.setLogLevel(level)
    if not capture.isOpened():
        size = path.stat().st_size
        raise InputFileError(
            where=str(path),
            seen="an empty file"
            if size == 0
            else f"{size} bytes that are not a video, or one cut off before its index",
            expected="a video that FFmpeg opens (mp4, mov, mkv, avi, ts ...)",
            advice="play the file with another program; copy it again from the camera",
        )
    return capture


def _head(capture: cv2.VideoCapture, path: Path) -> VideoHead:
    rate = capture.get(cv2.CAP_PROP_FPS)
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if min(size) < 1:
        raise _no_frames(path)
    frames = int(max(0.0, capture.get(cv2.CAP_PROP_FRAME_COUNT)))
    return VideoHead(frame_rate=rate if 0.01 < rate < 1e5 else 25.0, image_size=size, frames=frames)


def _no_frames(path: Path) -> InputFileError:
    return InputFileError(
        where=str(path),
        seen="no frame that can be decoded",
        expected="at least one picture",
        advice="play the file with another program; copy it again from the camera",
    )


def _sane(time_s: npt.NDArray[np.float64], rate: float) -> npt.NDArray[np.float64]:
    """The same times; frame / rate where the container has none (all equal)."""
    if len(time_s) > 1 and np.any(np.diff(time_s) <= 0):
        return np.asarray(np.arange(len(time_s)) / rate)
    return time_s
