"""What is around a candidate, and how it moved: parallax is no motion.

One homography carries the plane that fits most of a picture; what stands above or beyond that plane moves against it
without moving. So a candidate has to leave its surroundings too: corners in a frame around its box, followed from one
picture to the next, tell how far they went beyond the homography.
"""

from __future__ import annotations

import cv2
import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.tracking.scene.background import moved
from pipeline.tracking.video.frames import Image

RING, LEAST_RING_PX = 1.5, 24.0
"""How far around a box its surroundings reach, in half sides of it, and pixels at least. Doubled, they reach things at
other depths."""
INNER = 1.3
"""Of the box's half sides: what is left out as the candidate itself."""
CORNERS, FEWEST = 40, 6
"""Corners that are followed at most; with fewer nothing is known of the surroundings."""
SMALLEST_PX, MARGIN_PX = 16, 16
UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.03)


def surroundings_shift(
    before: Image, now: Image, centre_px: Floats, size_px: tuple[float, float], cur_from_prev: Floats
) -> Floats:
    """By how much (2,) pixels the surroundings of a box in `before` moved beyond the background's homography.

    centre_px, size_px  of the box; zero comes out where too few corners tell
    """
    half = np.array(size_px) / 2
    low, high = _inside(centre_px, half + np.maximum(RING * half, LEAST_RING_PX), before)
    if (high - low).min() < SMALLEST_PX:
        return np.zeros(2)
    corners = _corners(before, low, high, *_inside(centre_px, INNER * half + 2, before))
    if len(corners) < FEWEST:
        return np.zeros(2)
    expected = np.array([moved(cur_from_prev, point)[0] for point in corners])
    low = np.minimum(low, np.floor(expected.min(axis=0) - MARGIN_PX)).astype(int).clip(0)
    high = np.maximum(high, np.ceil(expected.max(axis=0) + MARGIN_PX)).astype(int)
    first, second = (_grey(picture, low, high) for picture in (before, now))
    guess = (expected - low).astype(np.float32)[:, None]
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, (corners - low).astype(np.float32)[:, None], guess.copy(), winSize=(11, 11), maxLevel=2,
        criteria=UNTIL, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    good = status[:, 0] == 1
    if good.sum() < FEWEST:
        return np.zeros(2)
    return np.asarray(np.median((found - guess)[good, 0], axis=0), np.float64)


def _corners(picture: Image, low: Ints, high: Ints, inner_low: Ints, inner_high: Ints) -> Floats:
    """Corners (k, 2) in the frame between two boxes, pixels of the whole picture."""
    grey = _grey(picture, low, high)
    mask = np.full(grey.shape, 255, np.uint8)
    own_low, own_high = inner_low - low, inner_high - low
    mask[own_low[1] : own_high[1], own_low[0] : own_high[0]] = 0
    found = cv2.goodFeaturesToTrack(grey, CORNERS, 0.02, 5, mask=mask)
    return np.zeros((0, 2)) if found is None else np.asarray(found[:, 0] + low, np.float64)


def _grey(picture: Image, low: Ints, high: Ints) -> Image:
    return np.asarray(cv2.cvtColor(picture[low[1] : high[1], low[0] : high[0]], cv2.COLOR_BGR2GRAY), np.uint8)


def _inside(centre_px: Floats, reach_px: Floats, picture: Image) -> tuple[Ints, Ints]:
    """Corners (2,) of a box around a place, as far as the picture goes."""
    size = np.array(picture.shape[1::-1])
    low, high = np.floor(centre_px - reach_px), np.ceil(centre_px + reach_px)
    return np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
