"""The coarse tracker: says roughly where a target went, in a picture made for it.

OpenCV's KCF and CSRT work in whole pixels, without scale or rotation, and look two box sizes far. So they are given a
*chip*: the image around the predicted target, turned and scaled back to how the target looked at first, with the box
about 16 pixels wide. In a chip the target hardly moves, small targets are large enough, large ones are cheap, and a
step of one chip pixel is a fraction of an image pixel.

KCF trains, but does not search, in its first update; it is therefore shown its first chip twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import TrackerName
from pipeline.tracking.records import changed
from pipeline.tracking.target.template import Warp
from pipeline.tracking.video.frames import Image

BOX_AREA, CONTEXT = 16.0**2, 1.6  # chip pixels of the box; how much wider than the target it is
CHIP_OVER_BOX = 3
SMOOTH_LENGTHS = (8, 9, 10, 12, 15, 16, 18, 20, 24, 25, 27, 30, 32, 36, 40, 45, 48, 50, 54, 60, 64, 72, 75, 80, 90, 96)
DETECT_THRESHOLD = 0.3


class BoxTracker(Protocol):
    """What OpenCV's trackers have in common."""

    def init(self, image: Image, boundingBox: tuple[int, int, int, int]) -> None:
        """Starts at a box (x, y, width, height)."""

    def update(self, image: Image) -> tuple[bool, Any]:
        """Whether it was found, and its box."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Coarse:
    """A box tracker at work. The tracker itself learns, and so changes, with every look.

    box      (x, y, width, height) in the chip, as it last reported
    chip_px  (width, height) of the chip
    scale    chip pixels for one pixel of the first box's frame
    """

    tracker: BoxTracker
    box: tuple[int, int, int, int]
    chip_px: tuple[int, int]
    scale: float

    @property
    def centre(self) -> Floats:
        """Of the box, chip coordinates."""
        return np.array(_middle(self.box))

    @property
    def strayed(self) -> bool:
        """Whether the box has moved so far from the chip's middle that it will soon see the chip's edge."""
        x, y = _middle(self.box)
        width, height = self.chip_px
        return abs(x - (width - 1) / 2) > self.box[2] * 0.45 or abs(y - (height - 1) / 2) > self.box[3] * 0.45


def _middle(box: tuple[int, int, int, int]) -> tuple[float, float]:
    x, y, w, h = box
    return x + (w - 1) / 2, y + (h - 1) / 2


def start_coarse(name: TrackerName, image: Image, warp: Warp, size_px: tuple[float, float]) -> Coarse:
    """A box tracker on a target of `size_px` (in the first box's frame) that lies under `warp`."""
    wanted = np.maximum(np.array(size_px) * CONTEXT, 6.0)
    scale = float(np.clip(np.sqrt(BOX_AREA / wanted.prod()), 0.02, 3.0))
    w, h = (_smooth(length * scale) for length in wanted)
    chip_px = CHIP_OVER_BOX * w, CHIP_OVER_BOX * h
    coarse = Coarse(tracker=_made(name), box=(w, h, w, h), chip_px=chip_px, scale=scale)
    chip = _chip(coarse, image, warp)
    coarse.tracker.init(chip, coarse.box)
    if name == "kcf":
        coarse.tracker.update(chip)
    return coarse


def look(coarse: Coarse, image: Image, predicted: Warp) -> tuple[Coarse, Floats | None]:
    """One frame further: where the box went, image pixels (2,), or None where it was not found."""
    before = coarse.centre
    good, box = coarse.tracker.update(_chip(coarse, image, predicted))
    if not good:
        return coarse, None
    x, y, w, h = (round(v) for v in box)
    after = changed(coarse, box=(x, y, w, h))
    return after, predicted.centre_px + predicted.linear @ (after.centre - before) / coarse.scale


def _chip(coarse: Coarse, image: Image, warp: Warp) -> Image:
    """The image with the warp's centre at the box's centre, turned and scaled back."""
    linear = warp.linear / coarse.scale
    corner = warp.centre_px - linear @ coarse.centre
    chip = cv2.warpAffine(
        image,
        np.column_stack([linear, corner]),
        coarse.chip_px,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(chip, np.uint8)


def _smooth(length: float) -> int:
    """The nearest length whose double is quick to transform."""
    return min(SMOOTH_LENGTHS, key=lambda n: abs(n - length))


def _made(name: TrackerName) -> BoxTracker:
    made: BoxTracker
    if name == "csrt":
        made = cv2.TrackerCSRT.create()
    else:
        parameters = cv2.TrackerKCF.Params()
        parameters.detect_thresh = DETECT_THRESHOLD
        made = cv2.TrackerKCF.create(parameters)
    return made
