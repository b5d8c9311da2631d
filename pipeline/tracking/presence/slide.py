"""Whether a track has slid onto the scene: it begins to move exactly as the background does, as the target did not.

A template that adapts can come to look like anything, so its score is no evidence of presence. Two things it cannot
forge. With v the velocity over the ground that the target had while it was certainly seen, x the place now and g where
the ground that was under it dt ago is now,

    r = (x - g) . (v dt) / |v dt|^2

is about 1 while the target goes on and about 0 on anything that stands still, near or far (parallax moves that, but not
along with the target). And what is under the box now is found in an earlier frame: where the target was then, or where
that piece of the scene was. A target that brakes has the first and not the second; a slid track has both.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Keyframe, Scene, moved
from pipeline.tracking.settings import INSTANT_S, SLIDE
from pipeline.tracking.target.template import Pixels, Warp, sample
from pipeline.tracking.video.frames import Image


@dataclass(frozen=True, kw_only=True, eq=False)
class Trail:
    """Where a target was in its last frames.

    frame, time_s  (m,)
    own_px         (m, 2) where it was in its own frame
    ground_px      (m, 2) where the ground that was under it then is now
    by_box         (m,) whether the box tracker said so alone
    velocity       (2,) over the ground, px/s as seen now, while it was certainly seen; NaN where not known
    certain        number of the last frame up to which it is certain
    suspicious     frames in a row that look slid
    """

    frame: Ints
    time_s: Floats
    own_px: Floats
    ground_px: Floats
    by_box: Bools
    velocity: Floats
    certain: int
    suspicious: int = 0


def first_trail(frame: int, time_s: float, xy_px: Floats) -> Trail:
    """The trail of a target that was just boxed."""
    place = np.asarray(xy_px, float)[None]
    return Trail(
        frame=np.array([frame]), time_s=np.array([time_s]), own_px=place, ground_px=place, by_box=np.zeros(1, bool),
        velocity=np.full(2, np.nan), certain=frame,
    )  # fmt: skip


def carried_trail(trail: Trail, scene: Scene) -> Trail:
    """The same one frame later: the ground has moved in the picture."""
    if not len(trail.frame):
        return trail
    through = np.column_stack([trail.ground_px, np.ones(len(trail.ground_px))]) @ scene.cur_from_prev.T
    _, jacobian = moved(scene.cur_from_prev, trail.ground_px[-1])
    return changed(trail, ground_px=through[:, :2] / through[:, 2:], velocity=jacobian @ trail.velocity)


def extended(trail: Trail, scene: Scene, xy_px: Floats, size_px: float, by_box: bool) -> Trail:
    """The trail with the place in this frame, and what it says of certainty and velocity.

    size_px  geometric mean of the target's sides now
    by_box   whether the box tracker said so alone
    """
    recent: Bools = np.abs(scene.time_s - trail.time_s) < SLIDE.longest_s - INSTANT_S
    place = np.asarray(xy_px, float)
    longer = changed(
        trail,
        frame=np.append(trail.frame[recent], scene.frame),
        time_s=np.append(trail.time_s[recent], scene.time_s),
        own_px=np.vstack([trail.own_px[recent], place]),
        ground_px=np.vstack([trail.ground_px[recent], place]),
        by_box=np.append(trail.by_box[recent], by_box),
    )
    return _judged(longer, size_px)


def _judged(trail: Trail, size_px: float) -> Trail:
    """Certainty and velocity anew, with the last place."""
    dt_s = np.abs(trail.time_s[-1] - trail.time_s)
    way = trail.ground_px[-1] - trail.ground_px
    speed = float(np.hypot(*trail.velocity))
    if not np.isfinite(speed):
        at = int(np.argmax(dt_s >= SLIDE.first_s - INSTANT_S)) if dt_s[0] >= SLIDE.first_s - INSTANT_S else -1
        known = at >= 0 and len(trail.frame) > SLIDE.fewest
        return changed(
            trail, velocity=way[at] / dt_s[at] if known else trail.velocity, certain=int(trail.frame[-1])
        )  # fmt: skip
    least_px = max(SLIDE.least_way_px, SLIDE.least_way_sizes * size_px)
    far = np.flatnonzero(speed * dt_s >= least_px)
    far = far[far <= len(trail.frame) - 1 - SLIDE.fewest]
    if not len(far) and speed * SLIDE.longest_s >= least_px:  # not long enough seen yet
        return trail
    if not len(far):  # too slow to be told from the ground
        at = 0
        slow = way[at] / max(dt_s[at], 1e-9) if dt_s[at] >= SLIDE.first_s - INSTANT_S else trail.velocity
        velocity = trail.velocity + SLIDE.believe * (slow - trail.velocity)
        return changed(trail, velocity=velocity, certain=int(trail.frame[-1]), suspicious=0)
    at = int(far[-1])
    now = way[at] / dt_s[at]
    along = float(now @ trail.velocity) / speed**2
    if along < SLIDE.slid:
        return changed(trail, suspicious=trail.suspicious + 1)
    if along <= SLIDE.goes_on and trail.by_box[-1]:  # a box that slows down may be coming to rest on the scene
        return changed(trail, suspicious=0)
    certain = max(trail.certain, int(trail.frame[at])) if along > SLIDE.goes_on else trail.certain
    velocity = trail.velocity + SLIDE.believe * (now - trail.velocity)
    return changed(trail, velocity=velocity, certain=certain, suspicious=0)


def has_slid(trail: Trail, scene: Scene, size_px: Floats, doubtful: bool) -> bool:
    """Whether the last place of a trail is a piece of the scene: it stands still, and was seen there before.

    size_px   (2,) sides of the target now
    doubtful  whether its look was, since it was last certain: then standing still is enough where nothing else tells
    """
    if trail.suspicious < SLIDE.frames:
        return False
    told = scene_or_target(trail, scene, size_px)
    if told is None:
        return doubtful and trail.suspicious >= SLIDE.doubtful_frames
    if doubtful and trail.suspicious >= SLIDE.doubtful_frames and told[1] < told[0] + SLIDE.margin:
        return True
    return told[0] > max(SLIDE.least_scene, told[1] + SLIDE.margin)


def stopped(trail: Trail) -> Trail:
    """The trail of a target that stands still now and was not seen in the scene before: so it stopped."""
    dt_s = np.abs(trail.time_s[-1] - trail.time_s)
    if trail.suspicious < SLIDE.stop_frames or dt_s[0] <= 0:
        return trail
    at = int(np.argmin(np.abs(dt_s - SLIDE.first_s)))
    velocity = (trail.ground_px[-1] - trail.ground_px[at]) / max(float(dt_s[at]), 1e-9)
    return changed(trail, velocity=velocity, suspicious=0, certain=int(trail.frame[-1]))


def scene_or_target(trail: Trail, scene: Scene, size_px: Floats) -> tuple[float, float] | None:
    """Correlation (-1 to 1) of what is under the box now with the scene there before, and with the target then.

    None where no earlier frame holds the two apart.
    """
    size = float(np.sqrt(size_px.prod()))
    best: tuple[float, Keyframe, Floats, Floats, Floats] | None = None
    for key in scene.keys:
        row = np.flatnonzero(trail.frame == _frame_of(key, scene, trail))
        if not len(row):
            continue
        then, jacobian = moved(key.key_from_cur, trail.ground_px[-1])
        apart = float(np.hypot(*(then - trail.own_px[row[0]]))) / size
        if apart >= SLIDE.apart_sizes and (best is None or apart > best[0]):
            best = apart, key, then, trail.own_px[row[0]], jacobian
    if best is None:
        return None
    _, key, then, own, jacobian = best
    step = max(SLIDE.finest_px, size / SLIDE.sampled)
    shape = tuple(int(max(5, round(SLIDE.inner * side / step))) for side in size_px[::-1])
    now = sample(scene.pixels, Warp(linear=np.eye(2), centre_px=trail.own_px[-1]), (shape[0], shape[1]), step)
    reach = max(2, round(SLIDE.reach_sizes * size / step))
    return (
        _nearby(key.pixels, now, Warp(linear=jacobian, centre_px=then), reach, step),
        _nearby(key.pixels, now, Warp(linear=jacobian, centre_px=own), reach, step),
    )


def _frame_of(key: Keyframe, scene: Scene, trail: Trail) -> int:
    """The number of a keyframe's frame; a video that runs backwards counts the other way."""
    backwards = len(trail.frame) > 1 and trail.frame[-1] < trail.frame[0]
    return scene.frame + key.age if backwards else scene.frame - key.age


def _nearby(image: Image, wanted: Pixels, warp: Warp, reach: int, step_px: float) -> float:
    """The best correlation within `reach` samples of a place."""
    h, w = wanted.shape[:2]
    region = sample(image, warp, (h + 2 * reach, w + 2 * reach), step_px)
    match = np.nan_to_num(cv2.matchTemplate(region, wanted, cv2.TM_CCOEFF_NORMED))
    return float(match.max())
