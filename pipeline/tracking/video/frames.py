"""Video in: frames in order with the container's own times, decoded ahead of whoever uses them.

A frame's time is the presentation timestamp, read after the frame was (before, it is the previous frame's), and
counted from frame 0. Containers that say how they are rotated are shown upright.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from calibration.foundation.videos import video_name
from pipeline.tracking.records import VideoTimes
from pipeline.tracking.video.interlace import is_woven, upper_field
from pipeline.tracking.video.prefetch import prefetched

Image = npt.NDArray[np.uint8]
AHEAD = 6  # frames decoded in advance
THREADS_EACH, FEWEST_THREADS, MOST_THREADS = 3, 4, 16  # FFmpeg's for each processor: some wait for others' frames
MOST_REFUSED = 64  # times that a reader is asked for what lies behind something broken
SAME_S = 2e-3  # times closer than that are the same
JUDGED_FRAMES = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One decoded frame: its number, its time from frame 0, its pixels (h, w, 3) BGR; whether they were woven."""

    index: int
    time_s: float
    pixels: Image
    woven: bool = False


@dataclass(frozen=True, kw_only=True)
class VideoHead:
    """What a container says of itself; `frames` is a claim, not a count."""

    frame_rate: float
    image_size: tuple[int, int]
    frames: int


def video_times(path: Path, head: VideoHead | None = None) -> VideoTimes:
    """The times of every frame, from the container's packets: nothing is decoded.

    head  of `video_head`, where it is known already

    Raises InputFileError where there is no video or no frame in it.
    """
    head = head or video_head(path)  # of the upright picture; the packets know nothing of rotation
    capture = opened(path, [cv2.CAP_PROP_FORMAT, -1])
    stamps = array("d", grabbed(capture, head))
    capture.release()
    if not stamps:
        raise _no_frames(path)
    time_s = np.unique(stamps) if np.ptp(stamps) > 0 else np.array(stamps)
    return VideoTimes(
        frame_time_s=_sane(time_s - time_s[0], head.frame_rate), frame_rate=head.frame_rate, image_size=head.image_size
    )


def video_head(path: Path) -> VideoHead:
    """Frame rate, size and claimed length.

    Raises InputFileError where there is no video.
    """
    capture = opened(path)
    head = head_of(capture, path)
    capture.release()
    return head


def frames_of(
    path: Path, times: VideoTimes | Future[VideoTimes] | None = None, capture: cv2.VideoCapture | None = None
) -> Iterator[Frame]:
    """Every frame that decodes, in order; a thread decodes ahead, memory is constant.

    times    of `video_times`, where they are known already, or are being read
    capture  the video, where it is open already, at its beginning; it is released at the end

    Raises InputFileError where there is no video or not a single frame, or OpenCV leaves its pictures unconverted.
    """
    known = times or video_times(path)
    yield from prefetched(_one_moment(_decoded(path, known, capture or opened_to_the_end(path)), path), AHEAD)


def _one_moment(frames: Iterator[Frame], path: Path) -> Iterator[Frame]:
    """The frames, of which the first tell whether they are woven of two fields; then the upper field of each."""
    first = list(islice(frames, JUDGED_FRAMES))
    woven = _told_woven([frame.pixels for frame in first], path)
    for frame in chain(first, frames):
        yield replace(frame, pixels=upper_field(frame.pixels), woven=True) if woven else frame


def first_stamp_s(path: Path) -> float:
    """The container's own time of the first frame.

    Raises InputFileError where there is no video.
    """
    capture = opened(path)
    capture.grab()
    stamp = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
    capture.release()
    return float(stamp)


def _decoded(path: Path, known: VideoTimes | Future[VideoTimes], capture: cv2.VideoCapture) -> Iterator[Frame]:
    """Frames by their place among the container's times, so that one that does not decode leaves its number free."""
    try:
        head = head_of(capture, path)
        rate = head.frame_rate
        index, first, last = -1, 0.0, -1.0
        for stamp in grabbed(capture, head):
            read = capture.retrieve()
            if not read[0]:
                continue
            times = known.result().frame_time_s if isinstance(known, Future) else known.frame_time_s
            first = stamp if index < 0 else first
            time_s = stamp - first
            if index >= 0 and time_s <= last:  # a container without times
                time_s = last + 1.0 / rate
            index = _place(times, time_s, index + 1)
            yield Frame(index=index, time_s=time_s, pixels=np.asarray(read[1], np.uint8))
            last = time_s
    finally:
        capture.release()
    if index < 0:
        raise _no_frames(path)


def grabbed(capture: cv2.VideoCapture, head: VideoHead) -> Iterator[float]:
    """The time (s) of every frame or packet, each grabbed when it comes; what is broken is stepped over.

    A reader that meets something broken says no more, as at the end; so it is asked for what lies behind, as long as
    the container claims that there is more.
    """
    last_s, done, refused = -np.inf, 0, 0
    while refused < MOST_REFUSED:
        if capture.grab():
            stamp_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            if refused == 0 or stamp_s > last_s:  # after a step it may hand out again what was seen
                yield stamp_s
                done, last_s = done + 1, max(last_s, stamp_s)
                refused = 0
        else:
            refused += 1
            if done == 0:
                return
            place = max(done, round(last_s * head.frame_rate) + 1) + refused
            if place >= head.frames - 1 or not capture.set(cv2.CAP_PROP_POS_FRAMES, place):
                return


def _place(times: Floats, time_s: float, least: int) -> int:
    """The number of the frame shown at a time, where the container knows that time; else the next."""
    at = int(np.searchsorted(times, time_s - SAME_S))
    return at if at > least and at < len(times) and abs(times[at] - time_s) < SAME_S else least


def interlaced(path: Path) -> bool:
    """Whether the first frames are woven of two fields.

    Raises InputFileError where there is no video, or OpenCV leaves its pictures unconverted (as of interlaced H.264).
    """
    capture = opened(path)
    first = [np.asarray(read[1], np.uint8) for _ in range(JUDGED_FRAMES) if (read := capture.read())[0]]
    capture.release()
    return _told_woven(first, path)


def _told_woven(first: list[Image], path: Path) -> bool:
    """Whether the first pictures are woven; pictures that never change are not the video's."""
    if len(first) == JUDGED_FRAMES and all(np.array_equal(first[0], other) for other in first[1:]):
        capture = opened(path)
        frames, early = head_of(capture, path).frames, capture.read()
        capture.set(cv2.CAP_PROP_POS_FRAMES, frames // 2)
        later = capture.read()
        capture.release()
        if frames > 2 * JUDGED_FRAMES and early[0] and later[0] and np.array_equal(early[1], later[1]):
            raise _unconverted(path)
    return is_woven(first)


def _unconverted(path: Path) -> InputFileError:
    return InputFileError(
        where=str(path),
        seen="pictures that never change, as when OpenCV cannot convert them (interlaced H.264)",
        expected="a progressive video, or one that OpenCV shows",
        advice=f"make it progressive: ffmpeg -i {path.name} -vf bwdif -c:v libx264 -crf 16 {path.stem}-progressive.mp4",
    )


def opened(path: Path, parameters: list[int] | None = None) -> cv2.VideoCapture:
    """The video, opened and silent.

    Raises InputFileError where it is none.
    """
    name = video_name(path)
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's own complaints; ours say more
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_ERROR)
    capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG, parameters or [])
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


def opened_to_the_end(path: Path) -> cv2.VideoCapture:
    """The video as `opened`, for decoding all of it in order: with more threads ahead than there are processors.

    Raises InputFileError where it is none.
    """
    threads = min(max(FEWEST_THREADS, THREADS_EACH * (os.cpu_count() or 1)), MOST_THREADS)
    return opened(path, [cv2.CAP_PROP_N_THREADS, threads])


def head_of(capture: cv2.VideoCapture, path: Path) -> VideoHead:
    """`video_head` of an open video."""
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
