"""Whether a track has slid onto the scene: it begins to move exactly as the background does, as the target did not.

A template that adapts can come to look like anything, so its score is no evidence of presence. Two things it cannot
forge. With v the velocity over the ground that the target had while it was certainly seen, x the place now and g where
the ground that was under it dt ago is now,

    r = (x - g) . (v dt) / |v dt|^2

is about 1 while the target goes on and about 0 on anything that stands still, near or far (parallax moves that, but not
along with the target). And what is under the box now is found in an earlier frame: where the target was then, or where
that piece of the scene was. A target that brakes has the first and not the second; a slid track has both.

Slowing down teaches no new velocity (a slide would be learned before it is seen), and the earlier pictures are from
when the target was certain (`past`), so that what was on the scene then is no target. The look of a small target
(`SlideSettings.telling_px`) tells little: it has to be seen to stop, else it is lost; and what is found after a
loss is refused where the scene held it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.tracking.presence.past import Past, carried_pasts, kept
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Keyframe, Scene, moved
from pipeline.tracking.settings import INSTANT_S, SLIDE
from pipeline.tracking.target.template import Warp, sample
from pipeline.tracking.video.frames import Image


@dataclass(frozen=True, kw_only=True, eq=False)
class Since:
    """A frame by its number and time, from which on something has been so."""

    frame: int
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trail:
    """Where a target was in its last frames.

    frame, time_s  (m,)
    own_px         (m, 2) where it was in its own frame
    ground_px      (m, 2) where the ground that was under it then is now
    by_box         (m,) whether the box tracker said so alone
    velocity       (2,) over the ground, px/s as seen now, while it was certainly seen; NaN where not known
    certain        number of the last frame up to which it is certain
    certain_s      its time
    suspicious     frames in a row that look slid
    slow           frames in a row in which it went less far than it should have
    left, behind   since when something went out of its box, and since when the scene had held what is there (`told`)
    asked_s        when the latter was last asked
    pasts          pictures of it and what was around it, oldest first
    """

    frame: Ints
    time_s: Floats
    own_px: Floats
    ground_px: Floats
    by_box: Bools
    velocity: Floats
    certain: int
    certain_s: float
    suspicious: int = 0
    slow: int = 0
    left: Since | None = None
    behind: Since | None = None
    asked_s: float = -math.inf
    pasts: tuple[Past, ...] = ()


def first_trail(frame: int, time_s: float, xy_px: Floats) -> Trail:
    """The trail of a target that was just boxed."""
    place = np.asarray(xy_px, float)[None]
    return Trail(
        frame=np.array([frame]), time_s=np.array([time_s]), own_px=place, ground_px=place, by_box=np.zeros(1, bool),
        velocity=np.full(2, np.nan), certain=frame, certain_s=time_s,
    )  # fmt: skip


def carried_trail(trail: Trail, scene: Scene) -> Trail:
    """The same one frame later: the ground has moved in the picture."""
    if not len(trail.frame):
        return trail
    through = np.column_stack([trail.ground_px, np.ones(len(trail.ground_px))]) @ scene.cur_from_prev.T
    _, jacobian = moved(scene.cur_from_prev, trail.ground_px[-1])
    return changed(
        trail, ground_px=through[:, :2] / through[:, 2:], velocity=jacobian @ trail.velocity,
        pasts=carried_pasts(trail.pasts, scene),
    )  # fmt: skip


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
        pasts=kept(trail.pasts, scene, place, size_px),
    )
    return _judged(longer, size_px)


def _judged(trail: Trail, size_px: float) -> Trail:
    """Certainty and velocity anew, with the last place."""
    dt_s = np.abs(trail.time_s[-1] - trail.time_s)
    way = trail.ground_px[-1] - trail.ground_px
    speed = float(np.hypot(*trail.velocity))
    if not np.isfinite(speed):
        known = dt_s[0] >= SLIDE.first_s - INSTANT_S and len(trail.frame) > SLIDE.fewest
        at = int(np.argmax(dt_s >= SLIDE.first_s - INSTANT_S)) if known else 0
        known = known and (float(np.hypot(*way[at])) > SLIDE.apart_px or dt_s[0] > SLIDE.sure_s)
        return _certain(trail, -1, way[at] / dt_s[at] if known else trail.velocity)
    least_px = max(SLIDE.least_way_px, SLIDE.least_way_sizes * size_px)
    far = np.flatnonzero((speed * dt_s >= least_px) & (dt_s >= SLIDE.first_s - INSTANT_S))
    far = far[far <= len(trail.frame) - 1 - SLIDE.fewest]
    if not len(far) and speed * SLIDE.longest_s >= least_px:  # not long enough seen yet
        return trail
    if not len(far):  # too slow to be told from the ground
        slow = way[0] / max(dt_s[0], 1e-9) if dt_s[0] >= SLIDE.first_s - INSTANT_S else trail.velocity
        return _certain(trail, -1, trail.velocity + SLIDE.believe * (slow - trail.velocity))
    at = int(far[-1])
    now = way[at] / dt_s[at]
    along = float(now @ trail.velocity) / speed**2
    if along <= SLIDE.goes_on:
        turned = float(np.hypot(*now)) > SLIDE.goes_on * speed
        suspicious = trail.suspicious + 1 if along < SLIDE.slid and not turned else 0
        return changed(trail, suspicious=suspicious, slow=trail.slow + 1)
    if along <= SLIDE.keeps_on:  # what slows down may be coming to rest on the scene: that is no new velocity
        return _certain(trail, at, trail.velocity)
    return _certain(trail, at, trail.velocity + SLIDE.believe * (now - trail.velocity))


def _certain(trail: Trail, at: int, velocity: Floats) -> Trail:
    """The trail of a target that is certain up to a row, with its velocity."""
    later = abs(int(trail.frame[-1]) - int(trail.frame[at])) < abs(int(trail.frame[-1]) - trail.certain)
    row = trail if not later else changed(trail, certain=int(trail.frame[at]), certain_s=float(trail.time_s[at]))
    return changed(row, velocity=velocity, suspicious=0, slow=0)


def has_slid(trail: Trail, scene: Scene, size_px: Floats, doubtful: bool) -> bool | None:
    """Whether the last place of a trail is a piece of the scene: it slows down, and was seen there before.

    A target that stops is seen where it was, and not where it stands: then this is False. None as long as nothing
    says either; what goes on like that is lost.

    size_px   (2,) sides of the target now
    doubtful  whether its look was, since it was last certain: then less is enough
    """
    if trail.slow < SLIDE.frames:
        return None
    small = float(np.sqrt(size_px.prod())) < SLIDE.telling_px
    still = trail.suspicious >= SLIDE.frames
    told = scene_or_target(trail, scene, size_px, trail.own_px[-1])
    if told is not None:
        margin = SLIDE.margin if still else SLIDE.slow_margin
        if (small or still) and told[0] > max(SLIDE.least_scene, told[1] + margin):
            return True
        least = max(SLIDE.least_target, told[0] + SLIDE.slow_margin) if small else told[0] + SLIDE.margin
        if told[1] >= least:
            return False
    elif still and _as_before(trail, scene, size_px):
        return False
    if trail.suspicious >= (SLIDE.doubtful_frames if doubtful else SLIDE.stop_frames):
        return small or doubtful
    dt_s = float(abs(trail.time_s[-1] - trail.certain_s))
    long = trail.slow >= SLIDE.stop_frames and (doubtful or dt_s > SLIDE.longest_s - INSTANT_S)
    return True if small and long else None


def is_other(trail: Trail, scene: Scene, size_px: Floats, place_px: Floats, lost_s: float, way_px: float) -> bool:
    """Whether what was found at a place after a loss is a thing of the scene, by where it was when the target was seen.

    Of a small target that was lost for long, also where no earlier picture says so and it was not seen to go on.

    way_px  that it went as the target would have, since it was found
    """
    told = scene_or_target(trail, scene, size_px, place_px)
    small = float(np.sqrt(size_px.prod())) < SLIDE.telling_px
    anywhere = small and lost_s > SLIDE.sure_s - INSTANT_S and way_px < SLIDE.seen_going_px
    if told is None:
        return anywhere
    return told[0] > told[1] + (-SLIDE.margin if anywhere else SLIDE.slow_margin)


def proved(trail: Trail) -> Trail:
    """The trail of a target that slowed down and was seen to be the one that moved."""
    certain = changed(trail, certain=int(trail.frame[-1]), certain_s=float(trail.time_s[-1]))
    dt_s = np.abs(trail.time_s[-1] - trail.time_s)
    if trail.slow < SLIDE.stop_frames or dt_s[0] <= 0:
        return certain
    at = int(np.argmin(np.abs(dt_s - SLIDE.first_s)))
    velocity = (trail.ground_px[-1] - trail.ground_px[at]) / max(float(dt_s[at]), 1e-9)
    return changed(certain, velocity=velocity, suspicious=0, slow=0)


def scene_or_target(trail: Trail, scene: Scene, size_px: Floats, place_px: Floats) -> tuple[float, float] | None:
    """Correlation (-1 to 1) of what is at a place now with the scene around the target before, and with the target.

    The scene around a small target is searched wherever parallax may have taken it. None where no earlier frame holds
    the two apart.
    """
    size = float(np.sqrt(size_px.prod()))
    least = max(SLIDE.apart_px / size, SLIDE.apart_sizes)
    best: tuple[float, Image, Floats, Floats, Floats] | None = None
    for past_from_cur, pixels, own in _earlier(trail, scene):
        then, jacobian = moved(past_from_cur, place_px)
        apart = min(float(np.hypot(*(then - own))) / size, SLIDE.apart_enough_sizes)
        if apart >= least and (best is None or apart > best[0]) and _holds(pixels, then):
            best = apart, pixels, then, own, jacobian
    if best is None:
        return None
    apart, pixels, then, own, jacobian = best
    step = max(SLIDE.finest_px, size / SLIDE.sampled)
    near = max(1, round(min(SLIDE.reach_sizes, apart / 2) * size / step))
    away = np.linalg.solve(jacobian, then - own) / step
    beside = near if size >= SLIDE.telling_px else round(SLIDE.beside_sizes * size / step)
    far = math.ceil(float(np.abs(away).max())) + beside
    match = matches(scene.pixels, place_px, pixels, Warp(linear=jacobian, centre_px=own), size_px, step, far)
    there = slice(far - near, far + near + 1)
    same = float(match[there, there].max())
    match[there, there] = -1.0
    if size >= SLIDE.telling_px:  # parallax is small beside it
        x, y = (round(far + float(v)) for v in away)
        match = match[max(0, y - near) : y + near + 1, max(0, x - near) : x + near + 1]
    return float(match.max()), same


def _as_before(trail: Trail, scene: Scene, size_px: Floats) -> bool:
    """Whether a target that never left its place over the ground looks as it did: then it stood there all the time."""
    step = max(SLIDE.finest_px, float(np.sqrt(size_px.prod())) / SLIDE.sampled)
    for past_from_cur, pixels, own in _earlier(trail, scene):
        _, jacobian = moved(past_from_cur, trail.own_px[-1])
        warp = Warp(linear=jacobian, centre_px=own)
        match = matches(scene.pixels, trail.own_px[-1], pixels, warp, size_px, step, 2)
        if float(match.max()) > SLIDE.as_before:
            return True
    return False


def matches(
    image: Image, place_px: Floats, earlier: Image, warp: Warp, size_px: Floats, step_px: float, reach: int
) -> Floats:
    """Correlations of what is at a place now with an earlier picture, `reach` steps around a warp there."""
    h, w = (int(max(5, round(SLIDE.inner * side / step_px))) for side in size_px[::-1])
    now = sample(image, Warp(linear=np.eye(2), centre_px=place_px), (h, w), step_px)
    region = sample(earlier, warp, (h + 2 * reach, w + 2 * reach), step_px)
    return np.asarray(np.nan_to_num(cv2.matchTemplate(region, now, cv2.TM_CCOEFF_NORMED)), float)


def _earlier(trail: Trail, scene: Scene) -> Iterator[tuple[Floats, Image, Floats]]:
    """(what leads there, picture, place of the target in it) of frames in which the target is certain, newest first."""
    since = abs(scene.frame - trail.certain)
    for key in scene.keys:
        row = np.flatnonzero(trail.frame == _frame_of(key, scene, trail))
        if len(row) and key.age >= since:
            yield key.key_from_cur, key.pixels, trail.own_px[row[0]]
    for past in trail.pasts[::-1]:
        if abs(scene.frame - past.frame) >= max(since, 1):
            yield np.asarray(np.linalg.inv(past.cur_from_past), float), past.pixels, past.own_px


def _holds(image: Image, point_px: Floats) -> bool:
    x, y = point_px.tolist()
    return bool(0 <= x < image.shape[1] and 0 <= y < image.shape[0])


def _frame_of(key: Keyframe, scene: Scene, trail: Trail) -> int:
    """The number of a keyframe's frame; a video that runs backwards counts the other way."""
    backwards = len(trail.frame) > 1 and trail.frame[-1] < trail.frame[0]
    return scene.frame + key.age if backwards else scene.frame - key.age
