"""Single frames out of a video: which ones can be had for how much decoding, and their pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Ints
from calibration.foundation.capture import Capture, FrameIndex

Pixels = npt.NDArray[np.uint8]


def affordable(frames: Sequence[int], index: FrameIndex, most: int) -> tuple[set[int], int]:
    """Of `frames`, the most important first, those that cost no more than `most` decoded frames; and what they cost.

    A frame costs all from its key frame on, unless a later one of them is taken already. The first costs nothing.
    """
    entry: Ints = index.entry if index.seekable else np.zeros_like(index.entry)
    _, first, group = np.unique(entry, return_index=True, return_inverse=True)
    reached: dict[int, int] = {}
    chosen: set[int] = set()
    spent = 0
    for frame in frames:
        if not 0 <= frame < len(entry):
            continue
        own = int(group[frame])
        begin = reached.get(own, int(first[own]))
        more = max(0, frame - begin)
        if spent + more <= most:
            spent += more
            reached[own] = max(begin, frame)
            chosen.add(frame)
    return chosen, spent


def frames_of(capture: Capture, wanted: Sequence[int], index: FrameIndex) -> Iterator[tuple[int, Pixels]]:
    """Number and pixels (h, w, 3) BGR of the frames `wanted`, which increase; what does not decode is left out."""
    waiting = list(wanted)
    while waiting:
        goal = waiting[0]
        for shot in capture.shots_from(goal, index):
            while waiting and waiting[0] < shot.number:
                waiting.pop(0)
            if waiting and shot.number == waiting[0]:
                yield waiting.pop(0), capture.pixels(shot)
            if not waiting or (index.seekable and index.entry[waiting[0]] > index.entry[goal]):
                break
        else:
            return
        if waiting and waiting[0] == goal:
            waiting.pop(0)
