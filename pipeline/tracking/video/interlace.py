"""Interlaced video: two half pictures of different moments, woven line by line.

Where something moves in a woven picture, a line differs more from the lines next to it than from those two away; in a
picture of one moment it differs less. A woven picture is reduced to its upper field: its lines at their places, the
lines between interpolated, so that geometry and the moment are one again.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]

EVERY_COLUMN = 4  # in so many is looked at
MOVED_LEVELS, LEAST_MOVED, WOVEN_RATIO = 12, 0.002, 1.15


def is_woven(pictures: Iterable[Image]) -> bool:
    """Whether consecutive pictures are interlaced, judged where they changed; False where hardly anything moves."""
    neighbours, apart, before = 0.0, 0.0, None
    for picture in pictures:
        grey = cv2.cvtColor(np.ascontiguousarray(picture[:, ::EVERY_COLUMN]), cv2.COLOR_BGR2GRAY).astype(np.int16)
        if before is not None and before.shape == grey.shape:
            moved = np.abs(grey - before)[2:-2] > MOVED_LEVELS
            if moved.mean() > LEAST_MOVED:
                neighbours += float(np.abs(2 * grey[2:-2] - grey[1:-3] - grey[3:-1])[moved].sum())
                apart += float(np.abs(2 * grey[2:-2] - grey[:-4] - grey[4:])[moved].sum())
        before = grey
    return neighbours > WOVEN_RATIO * apart > 0


def upper_field(picture: Image) -> Image:
    """The picture (h, w, 3) of the upper field's moment; the last line repeats where it has none below."""
    shown = picture.copy()
    above = picture[0:-1:2]
    below = np.concatenate([picture[2::2], picture[-2:-1] if len(picture) % 2 == 0 else picture[:0]])
    shown[1::2] = cv2.addWeighted(above, 0.5, below, 0.5, 0.0)
    return shown
