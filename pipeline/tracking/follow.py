"""Following one target from frame to frame: predict, look, refine, verify; when it is hidden, wait and search.

predict   the course over the ground, carried by the background's motion (`kinematics`)
look      the coarse tracker in a chip around the prediction (`coarse`)
refine    sub-pixel alignment with the slowly adapting template (`align`)
verify    correlation, share of agreeing pixels, distance from the prediction
hidden    no learning; the region where the target can be is searched (`search`); a find counts when the next frames
          confirm it
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calibration.arrays import Floats
from pipeline.records import Box
from pipeline.tracking.align import Alignment, align
from pipeline.tracking.background import Scene, moved
from pipeline.tracking.coarse import look, start_coarse
from pipeline.tracking.followed import Doubt, Fix, Followed
from pipeline.tracking.kinematics import Course, carried, corrected, first_course
from pipeline.tracking.search import best_nearby
from pipeline.tracking.settings import TrackingSettings
from pipeline.tracking.template import Pixels, Template, Warp, adapted, contrasted, first_template, sample
from pipeline.tracking.video import Image

CONFIRMATIONS, MORE_EACH_S, MOST_CONFIRMATIONS = 2, 1.5, 6  # frames that must agree with a find; more after long losses
LEAST_AGREEING, LEAST_INSIDE = 0.4, 0.7
# what (score, share agreeing) may fall below the usual: to learn from, to be found again, to be followed
TO_LEARN, TO_RETURN, TO_FOLLOW = np.array([0.06, 0.08]), np.array([0.15, 0.2]), np.array([0.3, 0.4])
USUAL_RATE, USUAL_RATE_IN_DOUBT, SPREAD_RATE = 0.05, 0.01, 0.05
GATE_SIGMAS, GATE_SIZE = 4.0, 0.35  # how far from the prediction a fix may be: sigmas, and share of the target's size
NEW_SCORE = 0.42
# a find so close to the prediction (sigmas), so soon after it was lost, agreeing so nearly, may score so much less
EXPECTED_SIGMAS, EXPECTED_S, EXPECTED_AGREEING, EXPECTED_BONUS = 2.0, 1.0, 0.2, 0.22
LEAST_AWAY_PX = 2.0  # that a target must have moved to be told from what is behind it
APART_EVERY = 3  # frames between comparisons of a target that is well known
TURNS_RAD = (0.0, 0.35, 0.0, -0.35)  # tried in turn while a target is hidden
SIGMA_FLOOR_PX, VIEW_SHARE = 0.05, 0.01


def begin(image: Image, box: Box, settings: TrackingSettings) -> tuple[Followed, Fix]:
    """Takes up a target at its first box."""
    centre, size = np.array(box.centre_px), (box.width, box.height)
    template = first_template(image, centre, size)
    target = Followed(
        template=template,
        linear=np.eye(2),
        course=first_course(centre, max(size)),
        coarse=start_coarse(settings.tracker, image, Warp(linear=np.eye(2), centre_px=centre), size),
    )
    return target, Fix(frame=box.frame, xy_px=box.centre_px, linear=np.eye(2), sigma_px=SIGMA_FLOOR_PX, score=1.0)


def follow(target: Followed, scene: Scene, settings: TrackingSettings) -> tuple[Followed, tuple[Fix, ...]]:
    """One frame further; the fixes that became certain with it (several where a return was confirmed)."""
    image, frame = scene.pixels, scene.frame
    if target.gone:
        return target, ()
    course, jacobian = carried(target.course, scene.cur_from_prev, scene.dt_s)
    target = replace(target, course=course, linear=jacobian @ target.linear)
    if target.hidden:
        return _searched(target, image, frame, scene, settings)
    target, found = _looked(target, image, settings)
    if found is None:
        lost = _lost_again(target, scene) if target.pending else _lost(target, scene)
        return lost, ()
    target = _learned(target, image, found, scene, settings)
    fix = _fix(frame, found, target)
    if not target.pending:
        return target, (fix,)
    assert target.doubt is not None
    pending, doubt = (*target.pending, fix), target.doubt.later(scene)
    if len(pending) <= doubt.frames:
        return replace(target, pending=pending, doubt=doubt), ()
    if doubt.stands_still(found.warp.centre_px):
        return _lost_again(target, scene), ()
    return replace(target, pending=(), doubt=None), pending


def _lost(target: Followed, scene: Scene) -> Followed:
    speed = float(np.hypot(*target.course.velocity))
    return replace(
        target, hidden=True, coarse=None, lost_s=scene.dt_s, scale_when_lost=target.scale, speed_when_lost=speed
    )


def _lost_again(target: Followed, scene: Scene) -> Followed:
    """A target whose find did not hold: lost as long as before."""
    return replace(target, hidden=True, coarse=None, pending=(), doubt=None, lost_s=target.lost_before_s + scene.dt_s)


def _looked(target: Followed, image: Image, settings: TrackingSettings) -> tuple[Followed, Alignment | None]:
    """The coarse tracker's answer refined; where that is in doubt, the better of it and of a search close by.

    A new target may score less: its first look is noisy and holds some of what is behind it.
    """
    predicted = Warp(linear=target.linear, centre_px=target.course.position_px)
    start = None
    if target.coarse is not None:
        coarse, start = look(target.coarse, image, predicted)
        target = replace(target, coarse=coarse)
    found = None
    if start is not None:
        found = align(image, target.template, replace(predicted, centre_px=start), target.linear)
        if _holds(target, found, settings.accept_score, TO_LEARN):
            return target, found
    reach = 4.0 + 3.0 * target.course.sigma_px
    near = best_nearby(image, target.template, predicted, reach, 2.0 + target.course.sigma_px, 1.0)
    least = min(NEW_SCORE, settings.accept_score) if target.new else settings.accept_score
    good = [a for a in (found, near) if a is not None and _holds(target, a, least, TO_FOLLOW)]
    best = max(good, key=lambda a: a.score, default=None)
    return (target if best is found else replace(target, coarse=None)), best


def _searched(
    target: Followed, image: Image, frame: int, scene: Scene, settings: TrackingSettings
) -> tuple[Followed, tuple[Fix, ...]]:
    """A hidden target: the whole region in which it can be."""
    target = replace(target, lost_s=target.lost_s + scene.dt_s)
    if target.lost_s > settings.longest_loss_s or not _can_return(target, image):
        return replace(target, gone=True), ()
    if not _in_view(target.course, image):
        return target, ()
    predicted = Warp(linear=target.linear, centre_px=target.course.position_px)
    reach = 4.0 + 3.0 * target.course.sigma_px
    turn = TURNS_RAD[frame % len(TURNS_RAD)] * (1 + frame // len(TURNS_RAD) % _turns(target.lost_s))
    looseness = min(2.0 + 10.0 * target.lost_s, 8.0)
    found = best_nearby(image, target.template, predicted, reach, 2.0 + target.course.sigma_px, looseness, turn)
    if found is None or not _holds(target, found, settings.return_score, TO_RETURN):
        return target, ()
    if _part_of_scene(target, found, scene):
        return target, ()
    wait = CONFIRMATIONS + min(MOST_CONFIRMATIONS - CONFIRMATIONS, int(MORE_EACH_S * target.lost_s))
    doubt = Doubt(frames=wait, anchor_px=found.warp.centre_px, speed=target.speed_when_lost)
    target = replace(target, hidden=False, coarse=None, doubt=doubt, lost_before_s=target.lost_s)
    return replace(
        _learned(target, image, found, scene, settings, learn=False), pending=(_fix(frame, found, target),)
    ), ()


def _turns(lost_s: float) -> int:
    """How many times the least turn a target may have turned while it was hidden."""
    return 1 + (lost_s > 0.4) + (lost_s > 1.2)


def _can_return(target: Followed, image: Image) -> bool:
    """Whether where it must be is still known: not far outside the image, where the background's motion is a guess."""
    height, width = image.shape[:2]
    x, y = target.course.position_px
    near = -width < x < 2 * width and -height < y < 2 * height
    return bool(near and 0.5 < target.scale / target.scale_when_lost < 2.0)


def _in_view(course: Course, image: Image) -> bool:
    height, width = image.shape[:2]
    slack = 3.0 * course.sigma_px + 10.0
    x, y = course.position_px
    return bool(-slack < x < width + slack and -slack < y < height + slack)


def _holds(target: Followed, found: Alignment, least_score: float, slack: Floats) -> bool:
    """Verification: it looks like the target, most of it is there, and it is where it can be.

    Where it is just where it was expected, and nearly all of it agrees, it may correlate less: the ground behind a
    small target takes part in its look.
    """
    size = target.template.size
    scale = found.warp.scale
    off = float(np.hypot(*(found.warp.centre_px - target.course.position_px)))
    seen = np.array([found.score, found.agreeing])
    least = np.maximum([least_score, LEAST_AGREEING], target.usual - slack * (1.4 if target.new else 1.0))
    expected = off < EXPECTED_SIGMAS * target.course.sigma_px + 0.5 and target.lost_s < EXPECTED_S
    if expected and found.agreeing >= target.usual[1] - EXPECTED_AGREEING:
        least[0] -= EXPECTED_BONUS
    return (
        bool(np.all(seen >= least))
        and found.inside >= LEAST_INSIDE
        and off < GATE_SIGMAS * target.course.sigma_px + GATE_SIZE * size * scale + 1.0
        and 0.7 < scale / target.scale < 1.4
    )


def _learned(
    target: Followed, image: Image, found: Alignment, scene: Scene, settings: TrackingSettings, learn: bool = True
) -> Followed:
    """The target after an accepted fix: course, shape, look, and a coarse tracker that is where the fix is."""
    quality = np.array([found.score, found.agreeing])
    whole = bool(np.all(quality >= target.usual - TO_LEARN))
    template = target.template
    if learn and not target.pending:
        spread_rate = max(SPREAD_RATE, 1.0 / (target.fixes + 3.0)) if target.new else SPREAD_RATE
        rate = settings.adaptation if whole or target.new else 0.0
        template = adapted(template, found.seen, found.residual, rate, spread_rate)
        if rate > 0 and (target.new or scene.frame % APART_EVERY == 0):
            template = _set_apart(template, target, found, scene, spread_rate * (1 if target.new else APART_EVERY))
    coarse = target.coarse
    if coarse is None or coarse.strayed:
        coarse = start_coarse(settings.tracker, image, found.warp, template.size_px)
    usual_rate = USUAL_RATE if whole or target.new else USUAL_RATE_IN_DOUBT
    course = corrected(target.course, found.warp.centre_px, max(0.1, _sigma_px(found, template.size_px)))
    return replace(
        target,
        template=template,
        linear=found.warp.linear,
        course=course,
        coarse=coarse,
        usual=target.usual + usual_rate * (quality - target.usual),
        lost_s=0.0,
        fixes=target.fixes + 1,
        travelled_px=target.travelled_px + float(np.hypot(*course.velocity)) * scene.dt_s,
    )


def _set_apart(template: Template, target: Followed, found: Alignment, scene: Scene, rate: float) -> Template:
    """Compares the target with the same ground in an earlier frame, from before the target was there."""
    difference = _difference_from_scene(target, found, scene, LEAST_AWAY_PX)
    return template if difference is None else contrasted(template, difference, rate)


def _part_of_scene(target: Followed, found: Alignment, scene: Scene) -> bool:
    """Whether what was found was already there when a target of this speed would have been elsewhere."""
    difference = _difference_from_scene(target, found, scene, 1.5 * LEAST_AWAY_PX)
    if difference is None:
        return False
    trust = target.template.trust
    return float((trust * difference).sum()) < float((trust * found.residual).sum())


def _difference_from_scene(target: Followed, found: Alignment, scene: Scene, least_px: float) -> Pixels | None:
    """Squared difference (h, w) of what was found from the same ground in an earlier frame.

    least_px  that the target must have moved since; None where it has not, or the ground was not in view
    """
    speed = float(np.hypot(*target.course.velocity)) * scene.dt_s
    size = target.template.size * found.warp.scale
    away = [key for key in scene.keys if speed * key.age >= min(least_px, 0.5 * size)]
    if not away or found.inside < 1.0:
        return None
    key = next((key for key in away if speed * key.age >= size), away[-1])
    then, jacobian = moved(np.asarray(np.linalg.inv(key.cur_from_key)), found.warp.centre_px)
    if not _inside_image(then, key.pixels):
        return None
    behind = Warp(linear=jacobian @ found.warp.linear, centre_px=then)
    ground = sample(key.pixels, behind, target.template.shape, target.template.step_px)
    return np.asarray(((ground - found.raw) ** 2).mean(axis=2), np.float32)


def _inside_image(point_px: Floats, image: Image) -> bool:
    return bool(np.all(point_px >= 0) and point_px[0] < image.shape[1] and point_px[1] < image.shape[0])


def _fix(frame: int, found: Alignment, target: Followed) -> Fix:
    x, y = found.warp.centre_px
    return Fix(
        frame=frame,
        xy_px=(float(x), float(y)),
        linear=found.warp.linear,
        sigma_px=_sigma_px(found, target.template.size_px),
        score=found.score,
    )


def _sigma_px(found: Alignment, size_px: tuple[float, float]) -> float:
    """Of a fix, per axis: a floor, the match's own uncertainty, and what a changed view does to a solid thing.

    The last grows with how much larger, smaller or more slanted the target looks than in its first box; it is the same
    from one frame to the next.
    """
    variance = float(found.covariance_px2[0, 0] + found.covariance_px2[1, 1]) / 2
    larger, smaller = _stretches(found.warp.linear)
    changed = abs(math.log(larger * smaller)) / 2 + math.log(larger / smaller)
    view = VIEW_SHARE * changed * math.sqrt(size_px[0] * size_px[1] * larger * smaller)
    return math.sqrt(SIGMA_FLOOR_PX**2 + variance + view**2)


def _stretches(linear: Floats) -> tuple[float, float]:
    """Singular values of (2, 2), written out: larger, smaller."""
    (a, b), (c, d) = linear.tolist()
    turned, mirrored = math.hypot(a + d, b - c), math.hypot(a - d, b + c)
    return (turned + mirrored) / 2, max(abs(turned - mirrored) / 2, 1e-9)
