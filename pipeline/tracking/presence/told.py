"""Small targets that their motion does not tell from the scene: what is in the box, against what was there before.

Some ten pixels look like much, and who is slow, or was boxed together with a post in front of it, has no velocity that
a slide would break. Two signs need none:

left    it stands where its box was, and the whole box does not look as it did: something went out of it, and what
        stands there is what was in front or behind
behind  what is in the box now was on the scene there before the target came, and is more like that than like the target

Either must last. A target as large as `SlideSettings.telling_px` is told by its look and is not asked.
"""

from __future__ import annotations

import math

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.presence.slide import Since, Trail, matches, scene_or_target
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene, moved
from pipeline.tracking.settings import INSTANT_S, SLIDE
from pipeline.tracking.target.template import Warp


def told(trail: Trail, scene: Scene, size_px: Floats) -> Trail:
    """The trail with both signs as they are on this frame.

    size_px  (2,) sides of the target now
    """
    size = float(np.sqrt(size_px.prod()))
    if size >= SLIDE.telling_px or not trail.pasts or not len(trail.frame) or trail.frame[-1] != scene.frame:
        return trail
    now = Since(frame=scene.frame, time_s=scene.time_s)
    gone_out = _stands(trail, size) and not _as_at_first(trail, scene, size_px)
    trail = changed(trail, left=(trail.left or now) if gone_out else None)
    if abs(scene.time_s - trail.asked_s) < SLIDE.ask_every_s - INSTANT_S:
        return trail
    held = scene_or_target(trail, scene, size_px, trail.own_px[-1])
    scenes = held is not None and held[0] > max(SLIDE.surely_scene, held[1] + SLIDE.behind_margin)
    return changed(trail, behind=(trail.behind or now) if scenes else None, asked_s=scene.time_s)


def not_there(trail: Trail, scene: Scene) -> bool:
    """Whether a sign has lasted."""
    return any(
        sign is not None and abs(scene.time_s - sign.time_s) > SLIDE.sure_s - INSTANT_S
        for sign in (trail.left, trail.behind)
    )


def doubted_since(trail: Trail, scene: Scene) -> int | None:
    """The number of the frame on which the earlier of the present signs began; None where there is none."""
    signs = [sign.frame for sign in (trail.left, trail.behind) if sign is not None]
    return max(signs, key=lambda frame: abs(scene.frame - frame), default=None)


def _as_at_first(trail: Trail, scene: Scene, size_px: Floats) -> bool:
    """Whether the whole box looks as in its first picture."""
    first, place = trail.pasts[0], trail.own_px[-1]
    _, jacobian = moved(np.asarray(np.linalg.inv(first.cur_from_past), np.float64), place)
    step = max(SLIDE.finest_px, float(np.sqrt(size_px.prod())) / SLIDE.sampled)
    warp = Warp(linear=jacobian, centre_px=first.own_px)
    return float(matches(scene.pixels, place, first.pixels, warp, size_px, step, 2).max()) > SLIDE.as_before


def _stands(trail: Trail, size: float) -> bool:
    """Whether it is where it was in its first picture, over the ground."""
    first = trail.pasts[0]
    there, _ = moved(first.cur_from_past, first.own_px)
    return math.dist(there.tolist(), trail.own_px[-1].tolist()) < SLIDE.apart_sizes * size
