"""A video from a frame back to its beginning: pieces are found by seeking, decoded forwards and handed out in reverse.

Containers seek badly, above all with uneven times, so a seek is only believed when the time of the frame it led to is
one of the times the whole video is known to have; from there the frames are counted.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from calibration.arrays import Floats
from pipeline.tracking.ahead import ahead
from pipeline.tracking.video import Frame, Image, opened

PIECE_BYTES, LONGEST_PIECE, SHORTEST_PIECE = 128 << 20, 48, 6
SAME_S = 2e-3


def frames_back(path: Path, last: int, frame_time_s: Floats) -> Iterator[Frame]:
    """Frames `last`, `last` - 1, ... 0 of a video whose times (n,) from frame 0 are known; memory is constant.

    Raises InputFileError where there is no video.
    """
    yield from ahead(_back(path, last, frame_time_s), SHORTEST_PIECE)


def _back(path: Path, last: int, frame_time_s: Floats) -> Iterator[Frame]:
    capture = opened(path)
    try:
        good, first = capture.read()
        first_s = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
        length = int(np.clip(PIECE_BYTES // max(1, first.nbytes), SHORTEST_PIECE, LONGEST_PIECE)) if good else 1
        end = last + 1
        while good and end > 0:
            start = max(0, end - length)
            piece, capture = _piece(capture, path, start, end, frame_time_s + first_s)
            for index in range(start + len(piece) - 1, start - 1, -1):
                yield Frame(index=index, time_s=float(frame_time_s[index]), pixels=piece[index - start])
            end = start
    finally:
        capture.release()


def _piece(
    capture: cv2.VideoCapture, path: Path, start: int, end: int, stamp_s: Floats
) -> tuple[list[Image], cv2.VideoCapture]:
    """Frames `start` to `end` - 1, and the capture to go on with."""
    capture, at = go_to(capture, path, start, stamp_s)
    while at < start - 1 and capture.grab():
        at += 1
    piece: list[Image] = []
    if at == start:  # the seek led to the first frame itself
        piece.append(np.asarray(capture.retrieve()[1], np.uint8))
    while len(piece) < end - start:
        good, pixels = capture.read()
        if not good:
            break
        piece.append(np.asarray(pixels, np.uint8))
    return piece, capture


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
