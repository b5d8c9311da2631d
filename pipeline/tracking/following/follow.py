"""Following one target from frame to frame: predict, look, refine, verify; when it is hidden, wait and search.

predict   the course over the ground, carried by the background's motion (`kinematics`)
look      the coarse tracker in a chip around the prediction (`coarse`)
refine    sub-pixel alignment with the slowly adapting template (`align`)
verify    correlation, share of agreeing pixels, distance from the prediction, odds against the scene behind (`verify`)
hidden    no learning; the region where the target can be is searched (`search`); a find counts when the next frames
          confirm it
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Box
from pipeline.tracking.presence.scene_behind import LEAST_AWAY_PX, aligned, behind_of, difference_from_scene
from pipeline.tracking.presence.verify import EXPECTED_S, TO_FOLLOW, TO_LEARN, TO_RETURN, can_be_there, holds, merit
from pipeline.tracking.records import changed
from pipeline.tracking.scene.background import Scene
from pipeline.tracking.settings import INSTANT_S, TrackingSettings
from pipeline.tracking.target.alignment import Alignment
from pipeline.tracking.target.coarse import look, start_coarse
from pipeline.tracking.target.fixes import SIGMA_FLOOR_PX, fix_of, sigma_px_of
from pipeline.tracking.target.kinematics import Course, carried, corrected, first_course
from pipeline.tracking.target.search import matches_nearby
from pipeline.tracking.target.template import Template, Warp, adapted, contrasted, first_template, informed
from pipeline.tracking.target.track_state import Doubt, Fix, TrackState
from pipeline.tracking.video.frames import Image

CONFIRMATIONS, MORE_EACH_S, MOST_CONFIRMATIONS = 2, 1.5, 6  # frames that must agree with a find; more after long losses
USUAL_RATE, USUAL_RATE_IN_DOUBT, SPREAD_RATE = 0.05, 0.01, 0.05
NEW_SCORE = 0.42
# how far below the usual score other turns and places are tried; what one must gain, and may still lack
IN_DOUBT, LEAST_GAIN, MOST_SHORT = 0.12, 0.08, 0.06
OTHER_TURNS_RAD, BESIDE = (0.3, -0.3, 0.7, -0.7), 0.7  # and of its size
NEAR_SIZES = 1.5  # own sizes from the prediction within which a target is found that is too slow to be told by its way
MOST_PENDING = 15  # frames for which a find that never looks as usual is held back; then dropped after a long loss
APART_EVERY = 3  # frames between comparisons of a target that is well known
TURNS_RAD = (0.0, 0.35, 0.0, -0.35)  # tried in turn while a target is hidden
SPIN_RATE, SPIN_LASTS_S, MOST_SPIN = 0.15, 1.0, 1.0  # how soon a turning is believed, how long while hidden; rad/s
LARGEST_TURN_RAD = 0.15  # from one frame to the next; more is a correction


def begin(
    image: Image, box: Box, settings: TrackingSettings, known: TrackState | None = None
) -> tuple[TrackState, Fix]:
    """Takes up a target at its first box; `known` is what was learned of it when it was followed the other way."""
    centre, size = np.array(box.centre_px), (box.width, box.height)
    template = first_template(image, centre, size)
    target = TrackState(
        template=template,
        linear=np.eye(2),
        course=first_course(centre, max(size)),
        coarse=start_coarse(settings.tracker, image, Warp(linear=np.eye(2), centre_px=centre), size),
    )
    if known is not None:
        target = changed(
            target, template=informed(template, known.template), usual=known.usual, fixes=known.fixes,
            travelled_px=known.travelled_px,
        )  # fmt: skip
    return target, Fix(frame=box.frame, xy_px=box.centre_px, linear=np.eye(2), sigma_px=SIGMA_FLOOR_PX, score=1.0)


def follow(target: TrackState, scene: Scene, settings: TrackingSettings) -> tuple[TrackState, tuple[Fix, ...]]:
    """One frame further; the fixes that became certain with it (several where a return was confirmed)."""
    image, frame = scene.pixels, scene.frame
    if target.gone:
        return target, ()
    target = carry(target, scene)
    if target.hidden:
        return _searched(target, image, frame, scene, settings)
    target, found = _looked(target, scene, settings)
    if found is None:
        return _lost(target, scene), ()
    elsewhere = not can_be_there(target, found)
    target = _learned(target, image, found, scene, settings, elsewhere)
    fix = fix_of(frame, found, target.sigma_px)
    if target.doubt is None:
        return target, (fix,)
    if elsewhere:
        return changed(target, pending=(fix,), doubt=changed(target.doubt, anchor_px=found.warp.centre_px)), ()
    pending, doubt = (*target.pending, fix), target.doubt.later(scene)
    as_usual = max(f.score for f in pending) > target.usual[0] - IN_DOUBT / 2
    if len(pending) <= (doubt.frames if as_usual else MOST_PENDING):
        return changed(target, pending=pending, doubt=doubt), ()
    long_lost = doubt.otherwise.lost_s > EXPECTED_S - INSTANT_S
    by_look_alone = long_lost and not doubt.told and not doubt.near
    if by_look_alone and len(pending) <= MOST_PENDING:
        return changed(target, pending=pending, doubt=doubt), ()
    if by_look_alone or doubt.goes_otherwise(found.warp.centre_px) or (long_lost and not as_usual):
        return doubt.otherwise, ()
    return changed(target, pending=(), doubt=None), pending


def carry(target: TrackState, scene: Scene) -> TrackState:
    """Where and how a target should be now; of one that was found in doubt, also if that was a mistake."""
    course, jacobian = carried(target.course, scene.cur_from_prev, scene.dt_s)
    doubt = target.doubt
    return changed(
        target, course=course, linear=jacobian @ target.linear @ _rotation(target.spin * scene.dt_s),
        spin=target.spin * math.exp(-scene.dt_s / SPIN_LASTS_S) if target.hidden else target.spin,
        lost_s=target.lost_s + scene.dt_s if target.hidden else target.lost_s,
        doubt=None if doubt is None else changed(doubt, otherwise=carry(doubt.otherwise, scene)),
    )  # fmt: skip


def _lost(target: TrackState, scene: Scene) -> TrackState:
    """A target that is not seen: hidden where it was, or where it was before a find that too few frames agreed with."""
    if target.doubt is not None:
        was = target.doubt.otherwise
        if len(target.pending) <= target.doubt.frames:
            return was
        return changed(target, hidden=True, coarse=None, pending=(), doubt=None, lost_s=was.lost_s)
    return hide(target, scene.dt_s)


def hide(target: TrackState, lost_s: float) -> TrackState:
    """The target as one that is not seen, for `lost_s` already."""
    return changed(
        target, hidden=True, coarse=None, lost_s=lost_s, scale_when_lost=target.scale, pending=(), doubt=None,
    )  # fmt: skip


def _looked(target: TrackState, scene: Scene, settings: TrackingSettings) -> tuple[TrackState, Alignment | None]:
    """The coarse tracker's answer refined; where that is in doubt, the better of it and of a search close by.

    A new target may score less: its first look is noisy and holds some of what is behind it.
    """
    image, predicted = scene.pixels, Warp(linear=target.linear, centre_px=target.course.position_px)
    start = None
    if target.coarse is not None:
        coarse, start = look(target.coarse, image, predicted)
        target = changed(target, coarse=coarse)
    found = None
    if start is not None:
        found = aligned(target, scene, changed(predicted, centre_px=start), 1.0)
        if holds(target, found, scene, settings.accept_score, TO_LEARN):
            return target, _put_right(target, found, scene)
    reach = 4.0 + 3.0 * target.course.sigma_px
    behind = behind_of(target, scene, LEAST_AWAY_PX)
    refined = partial(aligned, target, scene, looseness=1.0)
    near = matches_nearby(
        image, target.template, predicted, reach, 2.0 + target.course.sigma_px, refined, behind=behind
    )
    least = min(NEW_SCORE, settings.accept_score) if target.new else settings.accept_score
    good = [a for a in (found, *near) if a is not None and holds(target, a, scene, least, TO_FOLLOW)]
    best = max(good, key=lambda a: merit(target, a, scene), default=None)
    target = target if best is found else changed(target, coarse=None)
    return target, best if best is None else _put_right(target, best, scene)


def _put_right(target: TrackState, found: Alignment, scene: Scene) -> Alignment:
    """The target turned further or beside where it was found, where it is in doubt and looks just like itself so."""
    if found.score >= target.usual[0] - IN_DOUBT:
        return found
    refined = partial(aligned, target, scene, looseness=1.0)
    if scene.frame % 2:
        reach = BESIDE * target.template.size * found.warp.scale
        behind = behind_of(target, scene, LEAST_AWAY_PX)
        others = matches_nearby(scene.pixels, target.template, found.warp, reach, reach, refined, behind=behind)
    else:
        turned = [found.warp.linear @ _rotation(turn) for turn in OTHER_TURNS_RAD]
        others = [refined(changed(found.warp, linear=linear)) for linear in turned]
    least = max(found.score + LEAST_GAIN, target.usual[0] - MOST_SHORT)
    better = [other for other in others if other.score > least and other.inside == 1.0]
    return max(better, key=lambda a: a.score, default=found)


def _searched(
    target: TrackState, image: Image, frame: int, scene: Scene, settings: TrackingSettings
) -> tuple[TrackState, tuple[Fix, ...]]:
    """A hidden target: the whole region in which it can be."""
    known = min(1.0, target.template.size / settings.telling_px)
    if target.lost_s > settings.longest_loss_s * known + INSTANT_S or not _can_return(target, image):
        return changed(target, gone=True), ()
    if not _in_view(target.course, image):
        return target, ()
    predicted = Warp(linear=target.linear, centre_px=target.course.position_px)
    reach = 4.0 + 3.0 * target.course.sigma_px
    turn = TURNS_RAD[frame % len(TURNS_RAD)] * (1 + frame // len(TURNS_RAD) % _turns(target.lost_s))
    looseness = min(2.0 + 10.0 * target.lost_s, 8.0)
    behind = behind_of(target, scene, 1.5 * LEAST_AWAY_PX)
    refined = partial(aligned, target, scene, looseness=looseness)
    sigma = 2.0 + target.course.sigma_px
    near = matches_nearby(image, target.template, predicted, reach, sigma, refined, turn, behind)
    good = [a for a in near if holds(target, a, scene, settings.return_score, TO_RETURN)]
    found = max(good, key=lambda a: merit(target, a, scene), default=None)
    if found is None:
        return target, ()
    found = _put_right(target, found, scene)
    wait = CONFIRMATIONS + min(MOST_CONFIRMATIONS - CONFIRMATIONS, int(MORE_EACH_S * (target.lost_s + INSTANT_S)))
    off_px = math.dist(found.warp.centre_px, target.course.position_px)
    doubt = Doubt(
        otherwise=target,
        frames=wait,
        anchor_px=found.warp.centre_px,
        velocity=target.course.velocity,
        near=off_px < NEAR_SIZES * target.template.size * found.warp.scale,
    )
    target = changed(target, hidden=False, coarse=None, doubt=doubt)
    target = _learned(target, image, found, scene, settings, not can_be_there(target, found), learn=False)
    return changed(target, pending=(fix_of(frame, found, target.sigma_px),)), ()


def _turns(lost_s: float) -> int:
    """How many times the least turn a target may have turned while it was hidden."""
    return 1 + (lost_s > 0.4 + INSTANT_S) + (lost_s > 1.2 + INSTANT_S)


def _can_return(target: TrackState, image: Image) -> bool:
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


def _learned(
    target: TrackState, image: Image, found: Alignment, scene: Scene, settings: TrackingSettings, elsewhere: bool,
    learn: bool = True,
) -> TrackState:  # fmt: skip
    """The target after an accepted fix: course, shape, look, and a coarse tracker that is where the fix is.

    elsewhere  whether it was put right to where its course could not have led
    """
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
    turned = _turned(found.warp.linear, target.linear)
    spin = target.spin
    if learn and scene.dt_s > 0 and abs(turned) < LARGEST_TURN_RAD:
        spin = float(np.clip(spin + SPIN_RATE * turned / scene.dt_s, -MOST_SPIN, MOST_SPIN))
    course = target.course
    if elsewhere:
        course = changed(course, position_px=found.warp.centre_px)
    sigma_px = sigma_px_of(found, template)
    course = corrected(course, found.warp.centre_px, max(0.1, sigma_px))
    return changed(
        target,
        template=template,
        linear=found.warp.linear,
        spin=spin,
        course=course,
        coarse=coarse,
        usual=target.usual + usual_rate * (quality - target.usual),
        lost_s=0.0,
        fixes=target.fixes + 1,
        travelled_px=target.travelled_px + math.hypot(*course.velocity.tolist()) * scene.dt_s,
        sigma_px=sigma_px,
    )


def _set_apart(template: Template, target: TrackState, found: Alignment, scene: Scene, rate: float) -> Template:
    """Compares the target with the same ground in an earlier frame, from before the target was there."""
    difference = difference_from_scene(target, found, scene, LEAST_AWAY_PX)
    return template if difference is None else contrasted(template, difference, rate)


def _rotation(angle_rad: float) -> Floats:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def _turned(linear: Floats, predicted: Floats) -> float:
    """How much further than predicted a target has turned, radians."""
    (p, q), (r, s) = predicted.tolist()
    (a, b), (c, d) = (np.array([[s, -q], [-r, p]]) @ linear / (p * s - q * r)).tolist()
    return math.atan2(c - b, a + d)
