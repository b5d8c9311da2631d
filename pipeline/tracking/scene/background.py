"""How the scene behind the targets moved from one frame to the next.

x_cur ~ H x_prev for points of the ground (homogeneous pixels): corners (Shi-Tomasi) are followed by pyramidal
Lucas-Kanade on a reduced grey image, and H is fitted by RANSAC, so what moves on its own is left out. Near a point, H
acts as its value plus its Jacobian; that is what carries a target's position, velocity and shape to the next frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats
from pipeline.tracking.video.frames import Frame, Image

CORNERS, REFRESH, FEWEST = 120, 6, 12
KEY_EVERY, KEYS = 6, 3  # a frame in so many is kept, and so many of them
REDUCED_WIDTH_PX = 320
FLOW_WINDOW, FLOW_LEVELS = (9, 9), 3
FLOW_UNTIL = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.03


@dataclass(frozen=True, kw_only=True, eq=False)
class Keyframe:
    """An earlier frame, what leads from it to the current one (homography), and how many frames ago it was."""

    pixels: Image
    cur_from_key: Floats
    age: int

    @cached_property
    def key_from_cur(self) -> Floats:
        """What leads back to it."""
        return np.asarray(np.linalg.inv(self.cur_from_key))


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A frame and what it is to every target: number, time, pixels, motion of the background, earlier frames.

    woven    whether the frame was woven of two fields
    damaged  whether its pixels are made up in part: nothing in it is a measurement
    """

    frame: int
    time_s: float
    pixels: Image
    dt_s: float
    cur_from_prev: Floats
    keys: tuple[Keyframe, ...]
    woven: bool = False
    damaged: bool = False


def scenes(frames: Iterator[Frame]) -> Iterator[Scene]:
    """Every frame with the motion of its background since the one before; `frames` may run backwards in time."""
    background, last_s = None, 0.0
    for frame in frames:
        if background is None or background.size != frame.pixels.shape[1::-1]:
            background, motion, last_s = first_background(frame.pixels), np.eye(3), frame.time_s
        else:
            background, motion = advance(background, frame.pixels, kept=not frame.damaged)
        yield Scene(
            frame=frame.index,
            time_s=frame.time_s,
            pixels=frame.pixels,
            dt_s=abs(frame.time_s - last_s),
            cur_from_prev=motion,
            keys=background.keys,
            woven=frame.woven,
            damaged=frame.damaged,
        )
        last_s = frame.time_s


@dataclass(frozen=True, kw_only=True, eq=False)
class Background:
    """The scene as last seen: reduced grey image, its corners (k, 1, 2), frames since they were chosen.

    keys  earlier frames, newest first
    """

    grey: Image
    corners: npt.NDArray[np.float32]
    age: int
    factor: int
    keys: tuple[Keyframe, ...]

    @property
    def size(self) -> tuple[int, ...]:
        """(width, height) of the frames."""
        return self.keys[0].pixels.shape[1::-1]


def first_background(pixels: Image) -> Background:
    """The background as of the first frame."""
    factor = max(1, round(max(pixels.shape[:2]) / REDUCED_WIDTH_PX))
    grey = _reduced(pixels, factor)
    return Background(grey=grey, corners=_corners(grey), age=0, factor=factor, keys=(_key(pixels),))


def advance(before: Background, pixels: Image, kept: bool = True) -> tuple[Background, Floats]:
    """The background one frame later, and cur_from_prev (3, 3) in full-resolution pixels; identity where unknown.

    kept  whether the frame may become one of the earlier frames that tell what the scene looks like
    """
    grey = _reduced(pixels, before.factor)
    prev, cur = _flow(before, grey)
    motion = _fit(prev, cur)
    keep = len(cur) >= CORNERS // 2 and before.age < REFRESH
    full = _full(motion, before.factor)
    keys = tuple(
        Keyframe(pixels=k.pixels, cur_from_key=full @ k.cur_from_key, age=k.age + 1) for k in before.keys[:KEYS]
    )
    after = Background(
        grey=grey,
        corners=cur[:, None] if keep else _corners(grey),
        age=before.age + 1 if keep else 0,
        factor=before.factor,
        keys=(_key(pixels), *keys) if kept and keys[0].age >= KEY_EVERY else keys,
    )
    return after, full


def _key(pixels: Image) -> Keyframe:
    return Keyframe(pixels=pixels, cur_from_key=np.eye(3), age=0)


def moved(cur_from_prev: Floats, xy_px: Floats) -> tuple[Floats, Floats]:
    """Where H takes one point (2,), and its Jacobian (2, 2) there."""
    (a, b, c), (d, e, f), (g, h, i) = cur_from_prev.tolist()
    x, y = float(xy_px[0]), float(xy_px[1])
    w = g * x + h * y + i
    u, v = (a * x + b * y + c) / w, (d * x + e * y + f) / w
    return np.array([u, v]), np.array([[a - u * g, b - u * h], [d - v * g, e - v * h]]) / w


def _reduced(pixels: Image, factor: int) -> Image:
    """Grey, `factor` times smaller: the middle of each block, which is as good as its mean here and much faster."""
    image = pixels
    if factor > 1:
        size = max(1, image.shape[1] // factor), max(1, image.shape[0] // factor)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _corners(grey: Image) -> npt.NDArray[np.float32]:
    found = cv2.goodFeaturesToTrack(grey, CORNERS, 0.01, 8)
    return np.zeros((0, 1, 2), np.float32) if found is None else np.asarray(found, np.float32)


def _flow(before: Background, grey: Image) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    empty = np.zeros((0, 2), np.float32)
    if len(before.corners) == 0 or before.grey.shape != grey.shape:
        return empty, empty
    cur, good, _ = cv2.calcOpticalFlowPyrLK(
        before.grey, grey, before.corners, before.corners.copy(), winSize=FLOW_WINDOW, maxLevel=FLOW_LEVELS,
        criteria=FLOW_UNTIL,
    )  # fmt: skip
    seen = good.ravel() == 1
    return before.corners.reshape(-1, 2)[seen], np.asarray(cur, np.float32).reshape(-1, 2)[seen]


def _fit(prev: npt.NDArray[np.float32], cur: npt.NDArray[np.float32]) -> Floats:
    """Homography where many corners agree, similarity where few do, identity where too few."""
    if len(prev) < FEWEST:
        return np.eye(3)
    found, inlier = cv2.findHomography(prev, cur, cv2.RANSAC, 0.5, maxIters=200, confidence=0.995)
    if found is not None and inlier.sum() >= max(FEWEST, 0.4 * len(prev)) and _gentle(np.asarray(found, float), prev):
        return np.asarray(found, float)
    like: np.ndarray | None = cv2.estimateAffinePartial2D(prev, cur, method=cv2.RANSAC, ransacReprojThreshold=1.0)[0]
    if like is None:
        return np.eye(3)
    return np.vstack([like, [0.0, 0.0, 1.0]])


def _gentle(homography: Floats, points: npt.NDArray[np.float32]) -> bool:
    """Whether it neither mirrors nor collapses the image around the points' centre."""
    _, jacobian = moved(homography, points.mean(axis=0).astype(float))
    return bool(0.5 < np.linalg.det(jacobian) < 2.0)


def _full(motion: Floats, factor: int) -> Floats:
    """The same motion in full-resolution pixels: a reduced pixel's centre lies at factor * (i + 1/2) - 1/2."""
    shift = (factor - 1) / 2
    full_from_reduced = np.array([[factor, 0.0, shift], [0.0, factor, shift], [0.0, 0.0, 1.0]])
    return np.asarray(full_from_reduced @ motion @ np.linalg.inv(full_from_reduced))
