"""Pictures of a target and what was around it, from when it was certainly seen: what to compare a later place with.

The scene's own earlier frames are too few for a slow target, and none is from before a track slid when that is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene, moved
from pipeline.tracking.settings import SLIDE
from pipeline.tracking.video.frames import Image


@dataclass(frozen=True, kw_only=True, eq=False)
class Past:
    """A piece of an earlier frame around a target.

    frame          its number
    pixels         the piece
    own_px         (2,) the target in it, its own coordinates
    cur_from_past  (3, 3) what leads from it to the current frame
    """

    frame: int
    pixels: Image
    own_px: Floats
    cur_from_past: Floats


def kept(pasts: tuple[Past, ...], scene: Scene, xy_px: Floats, size_px: float) -> tuple[Past, ...]:
    """With a picture of this frame, where the target has moved over the ground since the last one.

    size_px  geometric mean of the target's sides
    """
    if pasts:
        last = pasts[-1]
        there, _ = moved(last.cur_from_past, last.own_px)
        if math.dist(there.tolist(), xy_px.tolist()) < SLIDE.past_every_sizes * size_px:
            return pasts
    reach = max(SLIDE.past_reach_sizes * size_px, SLIDE.past_reach_px)
    height, width = scene.pixels.shape[:2]
    left, top = (int(np.clip(v - reach, 0, n - 1)) for v, n in zip(xy_px, (width, height), strict=True))
    right, bottom = (int(np.clip(v + reach, 1, n)) for v, n in zip(xy_px, (width, height), strict=True))
    corner = np.array([left, top], float)
    past = Past(
        frame=scene.frame,
        pixels=scene.pixels[top : max(bottom, top + 1), left : max(right, left + 1)].copy(),
        own_px=xy_px - corner,
        cur_from_past=np.array([[1.0, 0.0, left], [0.0, 1.0, top], [0.0, 0.0, 1.0]]),
    )
    return (*pasts[:1], *pasts[1:][-(SLIDE.pasts - 2) :], past)


def carried_pasts(pasts: tuple[Past, ...], scene: Scene) -> tuple[Past, ...]:
    """The same one frame later."""
    return tuple(changed(past, cur_from_past=scene.cur_from_prev @ past.cur_from_past) for past in pasts)
