"""A target against the scene behind it, as an earlier frame shows that: what explains the picture better?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene, moved
from pipeline.tracking.target.alignment import Alignment, align
from pipeline.tracking.target.template import DOUBT, Pixels, Warp, over_ground, sample
from pipeline.tracking.target.track_state import TrackState
from pipeline.tracking.video.frames import Image

LEAST_AWAY_PX = 2.0  # that a target must have moved to be told from what is behind it
COVERED = 2.5  # sigmas of a pixel's difference that are as unlikely as its being covered
TOLD_FROM = 0.4  # how much of its own look must be known of a target for odds
OUTLINED_PX, OUTLINED_FROM = 24.0, 0.5  # targets smaller than that are seen against known ground, once they are known


def ground_behind(
    target: TrackState, scene: Scene, least_px: float, warp: Warp, shape: tuple[int, int], step_px: float
) -> Pixels | None:
    """The ground under a warp (h, w, 3) as an earlier frame has it, from when the target was not there.

    least_px  that the target must have moved since; None where it has not, or the ground was not in view
    """
    speed = float(np.hypot(*target.course.velocity)) * scene.dt_s
    size = target.template.size * warp.scale
    away = [key for key in scene.keys if speed * key.age >= min(least_px, 0.5 * size)]
    if not away:
        return None
    key = next((key for key in away if speed * key.age >= size), away[-1])
    then, jacobian = moved(key.key_from_cur, warp.centre_px)
    if not _inside_image(then, key.pixels):
        return None
    return sample(key.pixels, Warp(linear=jacobian @ warp.linear, centre_px=then), shape, step_px)


def behind_of(target: TrackState, scene: Scene, least_px: float) -> Callable[..., Pixels | None] | None:
    """`ground_behind` of a target for any warp, shape and step; None as long as its own pixels are not known."""
    return partial(ground_behind, target, scene, least_px) if target.template.compared >= TOLD_FROM else None


def difference_from_scene(target: TrackState, found: Alignment, scene: Scene, least_px: float) -> Pixels | None:
    """Squared difference (h, w) of what was found from the same ground in an earlier frame.

    least_px  that the target must have moved since; None where it has not, or the ground was not in view
    """
    if found.inside < 1.0:
        return None
    template = target.template
    ground = ground_behind(target, scene, least_px, found.warp, template.shape, template.step_px)
    return None if ground is None else mean_square(ground, found.raw)


def odds_against_scene(
    target: TrackState, found: Alignment, scene: Scene, least_px: float
) -> tuple[float, float] | None:
    """How much worse the scene behind explains what was found than the target does (ratio of squared residuals).

    Of the target whole, and partly covered: there a pixel is either the target's or, at a price, the scene's.
    None where the scene behind is not known, or not yet which pixels are the target's own.
    """
    if target.template.compared < TOLD_FROM:  # what else its box holds would speak against it
        return None
    difference = difference_from_scene(target, found, scene, least_px)
    if difference is None:
        return None
    trust, residual = target.template.trust, found.residual
    covered = np.minimum(residual, difference + COVERED**2 * (target.template.spread + DOUBT))
    scenes = float((trust * difference).sum())
    whole, partly = (scenes / max(1e-9, float((trust * own).sum())) for own in (residual, covered))
    return whole, partly


def aligned(target: TrackState, scene: Scene, start: Warp, looseness: float) -> Alignment:
    """Alignment from a start; of a small target over the ground that it is known to be in front of."""
    template = target.template
    ground = None
    if template.size < OUTLINED_PX and template.compared > OUTLINED_FROM:
        ground = ground_behind(target, scene, LEAST_AWAY_PX, start, template.shape, template.step_px)
    if ground is None:
        return align(scene.pixels, template, start, start.linear, looseness)
    found = align(scene.pixels, over_ground(template, ground), start, start.linear, looseness)
    return changed(found, residual=mean_square(found.seen, template.pixels))


def mean_square(one: Pixels, other: Pixels) -> Pixels:
    """Squared difference (h, w) of pictures (h, w, 3), mean over the colours."""
    apart = one - other
    apart *= apart
    return np.asarray((apart[..., 0] + apart[..., 1] + apart[..., 2]) / np.float32(3.0), np.float32)


def _inside_image(point_px: Floats, image: Image) -> bool:
    x, y = point_px.tolist()
    return bool(0 <= x < image.shape[1] and 0 <= y < image.shape[0])
