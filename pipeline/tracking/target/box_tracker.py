"""The box tracker: an opinion of its own on where the whole target is, which the alignment's template cannot bend.

OpenCV's CSRT is given a *chip*: the image around where the target is expected, scaled so that its box is
`BoxTrackerSettings.box_px` on a side. It follows the look of the whole box and its size, learns slowly, and gives
a box that is right to about a tenth of its side. Chips follow its own size alone, never the template's shape; where the
box strays from the chip's middle, or has become larger or smaller, it starts again at its own answer.

It is dear (ten to fifteen milliseconds of processor time a look), so it is asked seldom while nothing is in doubt.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.records import changed
from pipeline.tracking.settings import BOX_TRACKER
from pipeline.tracking.target.coarse import BoxTracker
from pipeline.tracking.target.template import Pixels, Warp, sample
from pipeline.tracking.video.frames import Image


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxTrack:
    """A box tracker at work; the tracker itself learns, and so changes, with every look.

    centre_px, size_px  (2,) the box as it was last seen, image pixels
    scale               chip pixels for an image pixel
    chip_px             the chip's side
    started_px          (2,) the box's size when the tracker was started, chip pixels
    time_s              when it looked last
    look                (h, w, 3) what the box held of late
    likeness            -1 to 1, correlation of what it holds now with that
    """

    tracker: BoxTracker
    centre_px: Floats
    size_px: Floats
    scale: float
    chip_px: int
    started_px: Floats
    time_s: float
    look: Pixels
    likeness: float = 1.0

    @property
    def size(self) -> float:
        """Geometric mean of the box's sides, image pixels."""
        return float(np.sqrt(self.size_px.prod()))


def start_box(image: Image, centre_px: Floats, size_px: Floats, time_s: float) -> BoxTrack:
    """A box tracker on a target of a size (2,) px around a place."""
    scale = min(BOX_TRACKER.largest_scale, BOX_TRACKER.box_px / float(np.sqrt(size_px.prod())))
    wanted = np.maximum(np.rint(size_px * scale), 4.0)
    side = int(BOX_TRACKER.chip_over_box * max(float(wanted.max()), BOX_TRACKER.box_px))
    box = BoxTrack(
        tracker=_made(), centre_px=np.asarray(centre_px, float), size_px=np.asarray(size_px, float), scale=scale,
        chip_px=side, started_px=wanted, time_s=time_s, look=_held(image, np.asarray(centre_px, float), size_px),
    )  # fmt: skip
    corner = np.rint((side - 1) / 2 - (wanted - 1) / 2).astype(int)
    x, y, w, h = (int(v) for v in (*corner, *wanted))
    box.tracker.init(_chip(box, image, box.centre_px + _rounding(box, corner)), (x, y, w, h))
    return box


def look_box(box: BoxTrack, image: Image, expected_px: Floats, time_s: float) -> BoxTrack | None:
    """One look: the box where it was found in a chip around where it is expected; None where it was not."""
    good, found = box.tracker.update(_chip(box, image, np.asarray(expected_px, float)))
    if not good:
        return None
    x, y, w, h = (float(v) for v in found)
    off = np.array([x + (w - 1) / 2, y + (h - 1) / 2]) - (box.chip_px - 1) / 2
    centre, size = expected_px + off / box.scale, np.array([w, h]) / box.scale
    held = _held(image, centre, size)
    likeness = _likeness(held, box.look)
    mixed = np.asarray(box.look + np.float32(BOX_TRACKER.remember) * (held - box.look), np.float32)
    after = changed(box, centre_px=centre, size_px=size, time_s=time_s, look=mixed, likeness=likeness)
    grown = float(np.sqrt(w * h / box.started_px.prod()))
    low, high = BOX_TRACKER.restart_size
    if np.abs(off).max() > BOX_TRACKER.restart_off * box.chip_px or not low < grown < high:
        return changed(start_box(image, centre, size, time_s), look=mixed, likeness=likeness)
    return after


def _rounding(box: BoxTrack, corner: Floats) -> Floats:
    """What whole chip pixels leave between the box's middle and the chip's, image pixels."""
    return np.asarray(((box.chip_px - 1) / 2 - (corner + (box.started_px - 1) / 2)) / box.scale)


def _held(image: Image, centre_px: Floats, size_px: Floats) -> Pixels:
    """What a box holds, always of the same shape."""
    n = BOX_TRACKER.look_px
    return sample(image, Warp(linear=np.diag(size_px / n), centre_px=centre_px), (n, n), 1.0)


def _likeness(now: Pixels, before: Pixels) -> float:
    """The best correlation of two looks, a little of one against the other."""
    cut = BOX_TRACKER.look_px // 8
    match = np.nan_to_num(cv2.matchTemplate(before, now[cut:-cut, cut:-cut].copy(), cv2.TM_CCOEFF_NORMED))
    return float(match.max())


def _chip(box: BoxTrack, image: Image, centre_px: Floats) -> Image:
    shift = (box.chip_px - 1) / 2 - box.scale * centre_px
    move = np.array([[box.scale, 0.0, shift[0]], [0.0, box.scale, shift[1]]])
    way = cv2.INTER_AREA if box.scale < BOX_TRACKER.area_below else cv2.INTER_LINEAR
    side = (box.chip_px, box.chip_px)
    return np.asarray(cv2.warpAffine(image, move, side, flags=way, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def _made() -> BoxTracker:
    parameters = cv2.TrackerCSRT.Params()
    parameters.use_segmentation = False
    parameters.template_size = BOX_TRACKER.template_px
    parameters.number_of_scales = BOX_TRACKER.scales
    made: BoxTracker = cv2.TrackerCSRT.create(parameters)
    return made
