"""What moves on its own between frames whose background moves too.

With frames a, b, c and the homographies that bring a and c onto b, a pixel of b moves when it differs both from a and
from c by more than its neighbourhood there explains:

    d(p) = min over k in (a, c) of  max(b(p) - high_k(p), low_k(p) - b(p), 0),      low, high: over 3 x 3 pixels of k

so a background that is off by a pixel, or seen a little from elsewhere, does not count. Pixels above the noise are
joined into blobs, and blobs have boxes.
"""

from __future__ import annotations

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Box
from pipeline.tracking.scene.background import Scene
from pipeline.tracking.video.frames import Image

LEAST_DIFFERENCE, NOISE_SIGMAS = 12.0, 6.0
LEAST_SIDE_PX, LARGEST_SHARE, LEAST_FILL = 5, 0.2, 0.25
MOST_BLOBS = 40
MARGIN_PX = 1


def moving_boxes(before: Scene, now: Scene, after: Scene, now_from_before: Floats, now_from_after: Floats) -> list[Box]:
    """Boxes in `now` around what differs from both other frames, the strongest first.

    now_from_before, now_from_after  (3, 3) homographies of the background
    """
    grey = _grey(now.pixels)
    off = np.minimum(
        _unexplained(grey, _grey(before.pixels), now_from_before),
        _unexplained(grey, _grey(after.pixels), now_from_after),
    )
    level = max(LEAST_DIFFERENCE, NOISE_SIGMAS * 1.4826 * float(np.median(off[::4, ::4])))
    mask = np.asarray(off > level, np.uint8)
    joined = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    count, _, stats, _ = cv2.connectedComponentsWithStats(joined)
    sums = [(_strength(off, mask, stats[k]), stats[k]) for k in range(1, count) if _plausible(stats[k], mask)]
    best = sorted(sums, key=lambda pair: -pair[0])[:MOST_BLOBS]
    return [_box(stat, now, mask.shape) for _, stat in best]


def _grey(pixels: Image) -> Image:
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)


def _unexplained(now: Image, other: Image, now_from_other: Floats) -> Image:
    """By how much each pixel lies outside what is around it in the other frame; 0 where that frame does not reach."""
    size = now.shape[1], now.shape[0]
    there = np.asarray(cv2.warpPerspective(other, now_from_other, size, flags=cv2.INTER_LINEAR), np.uint8)
    reached = cv2.warpPerspective(np.full_like(other, 255), now_from_other, size, flags=cv2.INTER_NEAREST)
    kernel = np.ones((3, 3), np.uint8)
    high, low = cv2.dilate(there, kernel), cv2.erode(there, kernel)
    off = cv2.max(cv2.subtract(now, high), cv2.subtract(low, now))
    inside = cv2.erode(np.asarray(reached, np.uint8), np.ones((9, 9), np.uint8))
    return np.asarray(cv2.bitwise_and(off, inside), np.uint8)


def _plausible(stat: np.ndarray, mask: Image) -> bool:
    x, y, w, h, _ = (int(v) for v in stat)
    filled = int(mask[y : y + h, x : x + w].sum())
    return (
        max(w, h) >= LEAST_SIDE_PX
        and min(w, h) >= 3
        and max(w, h) <= LARGEST_SHARE * max(mask.shape)
        and filled >= LEAST_FILL * w * h
    )


def _strength(off: Image, mask: Image, stat: np.ndarray) -> float:
    x, y, w, h, _ = (int(v) for v in stat)
    part = slice(y, y + h), slice(x, x + w)
    return float((off[part].astype(float) * mask[part]).sum())


def _box(stat: np.ndarray, now: Scene, shape: tuple[int, ...]) -> Box:
    """The blob's box and a margin, inside the image."""
    x, y, w, h, _ = (int(v) for v in stat)
    left, top = max(0, x - MARGIN_PX), max(0, y - MARGIN_PX)
    right, bottom = min(shape[1], x + w + MARGIN_PX), min(shape[0], y + h + MARGIN_PX)
    return Box(frame=now.frame, x=float(left), y=float(top), width=float(right - left), height=float(bottom - top))
