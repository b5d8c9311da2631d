"""A video from a frame back to its beginning: pieces are decoded from a key frame on and handed out in reverse."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.foundation.capture import Capture, FrameIndex
from pipeline.tracking.video.frames import Frame, frame_of, interlaced, opened_to_the_end
from pipeline.tracking.video.interlace import upper_field
from pipeline.tracking.video.prefetch import prefetched

PIECE_BYTES, LONGEST_PIECE, SHORTEST_PIECE = 128 << 20, 48, 6


def frames_back(path: Path, last: int, stream: int | None = None) -> Iterator[Frame]:
    """Frames `last`, `last` - 1, ... 0 of a video, damaged ones too; memory is constant.

    Raises InputFileError where there is no video.
    """
    yield from prefetched(_back(path, last, stream), SHORTEST_PIECE)


def _back(path: Path, last: int, stream: int | None) -> Iterator[Frame]:
    capture = opened_to_the_end(path, stream)
    try:
        width, height = capture.head().image_size
        index = capture.index()
        woven = interlaced(capture)
        length = int(np.clip(PIECE_BYTES // (3 * width * height), SHORTEST_PIECE, LONGEST_PIECE))
        end = min(last + 1, len(index.stamp_s))
        while end > 0:
            start = max(0, end - length)
            for frame in reversed(_piece(capture, start, end, index)):
                yield replace(frame, pixels=upper_field(frame.pixels), woven=True) if woven else frame
            end = start
    finally:
        capture.close()


def _piece(capture: Capture, start: int, end: int, index: FrameIndex) -> list[Frame]:
    """Frames `start` to `end` - 1, as many as decode."""
    piece = []
    for shot in capture.shots_from(start, index):
        if shot.number >= end:
            break
        if shot.number >= start:
            piece.append(frame_of(capture, shot, float(index.stamp_s[0])))
        if shot.number == end - 1:
            break
    return piece
