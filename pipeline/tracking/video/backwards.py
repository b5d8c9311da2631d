"""A video from a frame back to its beginning: pieces are found by seeking, decoded forwards and handed out in reverse.

Containers seek badly, above all with uneven times, so a seek is only believed when the time of the frame it led to is
one of the times the whole video is known to have; from there the frames are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.video.frames import SAME_S, Frame, Image, interlaced, opened
from pipeline.tracking.video.interlace import upper_field
from pipeline.tracking.video.prefetch import prefetched

PIECE_BYTES, LONGEST_PIECE, SHORTEST_PIECE = 128 << 20, 48, 6


def frames_back(path: Path, last: int, frame_time_s: Floats) -> Iterator[Frame]:
    """Frames `last`, `last` - 1, ... 0 of a video whose times (n,) from frame 0 are known; memory is constant.

    Raises InputFileError where there is no video.
    """
    yield from prefetched(_back(path, last, frame_time_s), SHORTEST_PIECE)


def _back(path: Path, last: int, frame_time_s: Floats) -> Iterator[Frame]:
    woven = interlaced(path)
    capture = opened(path)
    try:
        good, first = capture.read()
        first_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
        length = int(np.clip(PIECE_BYTES // max(1, first.nbytes), SHORTEST_PIECE, LONGEST_PIECE)) if good else 1
        end = last + 1
        while good and end > 0:
            start = max(0, end - length)
            piece, capture = _piece(capture, path, start, end, frame_time_s + first_s)
            for index in sorted(piece, reverse=True):
                pixels = upper_field(piece[index]) if woven else piece[index]
                yield Frame(index=index, time_s=float(frame_time_s[index]), pixels=pixels)
            end = start
    finally:
        capture.release()


def _piece(
    capture: cv2.VideoCapture, path: Path, start: int, end: int, stamp_s: Floats
) -> tuple[dict[int, Image], cv2.VideoCapture]:
    """Frames `start` to `end` - 1 by number, as many as decode, and the capture to go on with."""
    capture, at = go_to(capture, path, start, stamp_s)
    piece: dict[int, Image] = {}
    if at < 0 and capture.grab():
        at = 0
    while 0 <= at < end:
        if at >= start:
            piece[at] = np.asarray(capture.retrieve()[1], np.uint8)
        if not capture.grab():
            break
        at = _number(capture, at + 1, stamp_s)
    return piece, capture


def _number(capture: cv2.VideoCapture, least: int, stamp_s: Floats) -> int:
    """Of the frame just grabbed, by its time; the next where the container does not know that time."""
    seen_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
    nearest = int(np.argmin(np.abs(stamp_s - seen_s)))
    return nearest if nearest > least and abs(stamp_s[nearest] - seen_s) < SAME_S else least


def go_to(capture: cv2.VideoCapture, path: Path, wanted: int, stamp_s: Floats) -> tuple[cv2.VideoCapture, int]:
    """A capture that has grabbed frame `wanted` or one before it, and which (-1: none yet).

    stamp_s  (n,) the container's times of all frames
    """
    margin = 0
    while wanted - margin > 0:
        at = _sought(capture, wanted - margin, wanted, stamp_s)
        if at is not None:
            return capture, at
        margin = max(16, 4 * margin)
    capture.release()
    return opened(path), -1


def _sought(capture: cv2.VideoCapture, wanted: int, most: int, stamp_s: Floats) -> int | None:
    """Seeks to about frame `wanted`; the frame grabbed, or None where it is unknown or past `most`."""
    capture.set(cv2.CAP_PROP_POS_FRAMES, wanted)
    if not capture.grab():
        return None
    seen_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
    nearest = int(np.argmin(np.abs(stamp_s - seen_s)))
    return nearest if abs(stamp_s[nearest] - seen_s) < SAME_S and nearest <= most else None
