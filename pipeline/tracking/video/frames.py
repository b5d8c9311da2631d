"""Video in: frames in order with the container's own times, decoded ahead of whoever uses them.

A frame's time is its presentation time, counted from frame 0, the first that decodes. Frames that do not decode keep
their numbers; damaged ones are handed out only to who asks for them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats
from calibration.foundation.capture import Capture, FrameIndex, Shot, VideoHead, no_frames
from pipeline.tracking.records import VideoTimes
from pipeline.tracking.video.interlace import is_woven, upper_field
from pipeline.tracking.video.prefetch import prefetched

Image = npt.NDArray[np.uint8]
AHEAD = 6  # frames decoded in advance
THREADS_EACH, FEWEST_THREADS, MOST_THREADS = 3, 4, 16  # FFmpeg's for each processor: some wait for others' frames
JUDGED_FRAMES = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One decoded frame: its number, its time from frame 0, its pixels (h, w, 3) BGR; whether they were woven.

    damaged  the decoder concealed errors in it, or in what it was predicted from
    """

    index: int
    time_s: float
    pixels: Image
    woven: bool = False
    damaged: bool = False


def video_times(path: Path, stream: int | None = None) -> VideoTimes:
    """The times of every frame, from the container's packets: nothing but the first is decoded.

    stream  its number; else the one that moves

    Raises InputFileError where there is no video or no frame in it.
    """
    return indexed_times(path, stream)[0]


def indexed_times(path: Path, stream: int | None = None) -> tuple[VideoTimes, FrameIndex]:
    """`video_times` with the index that they come from, for who goes on to seek in the video."""
    capture = Capture(path, stream=stream)
    try:
        head, index = capture.head(), capture.index()
    finally:
        capture.close()
    times = VideoTimes(frame_time_s=from_first(index.stamp_s), frame_rate=head.frame_rate, image_size=head.image_size)
    return times, index


def from_first(stamp_s: Floats) -> Floats:
    """The same times counted from frame 0, free of the rounding that large times bring."""
    return np.asarray(np.round(stamp_s - stamp_s[0], 9))


def video_head(path: Path, stream: int | None = None) -> VideoHead:
    """Frame rate, size and claimed length.

    Raises InputFileError where there is no video.
    """
    capture = Capture(path, stream=stream)
    try:
        return capture.head()
    finally:
        capture.close()


def frames_of(
    path: Path, *, also_damaged: bool = False, stream: int | None = None, capture: Capture | None = None
) -> Iterator[Frame]:
    """Every frame that decodes, in order; a thread decodes ahead, memory is constant.

    also_damaged  whether those come too in which errors were concealed
    capture       the video, where it is open already, at its beginning; it is closed at the end

    Raises InputFileError where there is no video or not a single frame.
    """
    capture = capture or opened_to_the_end(path, stream)
    for frame in prefetched(_one_moment(_decoded(path, capture)), AHEAD):
        if also_damaged or not frame.damaged:
            yield frame


def opened_to_the_end(path: Path, stream: int | None = None) -> Capture:
    """The video for decoding all of it in order: with more threads ahead than there are processors.

    Raises InputFileError where it is none.
    """
    threads = min(max(FEWEST_THREADS, THREADS_EACH * (os.cpu_count() or 1)), MOST_THREADS)
    return Capture(path, stream=stream, threads=threads)


def _one_moment(frames: Iterator[Frame]) -> Iterator[Frame]:
    """The frames, of which the first tell whether they are woven of two fields; then the upper field of each."""
    first = list(islice(frames, JUDGED_FRAMES))
    woven = is_woven([frame.pixels for frame in first])
    for frame in chain(first, frames):
        yield replace(frame, pixels=upper_field(frame.pixels), woven=True) if woven else frame


def _decoded(path: Path, capture: Capture) -> Iterator[Frame]:
    first_s = None
    try:
        for shot in capture.shots():
            first_s = shot.stamp_s if first_s is None else first_s
            yield frame_of(capture, shot, first_s)
    finally:
        capture.close()
    if first_s is None:
        raise no_frames(path)


def frame_of(capture: Capture, shot: Shot, first_s: float) -> Frame:
    """A decoded frame with its pixels; `first_s` is the time of frame 0."""
    return Frame(
        index=shot.number, time_s=round(shot.stamp_s - first_s, 9), pixels=capture.pixels(shot), damaged=shot.damaged
    )


def interlaced(capture: Capture) -> bool:
    """Whether the first frames of a video that stands at its beginning are woven of two fields."""
    return is_woven([capture.pixels(shot) for shot in islice(capture.shots(), JUDGED_FRAMES)])
