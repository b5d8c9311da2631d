"""Verification: whether what was found is the target."""

from __future__ import annotations

import math

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.presence.scene_behind import LEAST_AWAY_PX, odds_against_scene
from pipeline.tracking.scene.background import Scene
from pipeline.tracking.settings import INSTANT_S
from pipeline.tracking.target.alignment import Alignment
from pipeline.tracking.target.track_state import TrackState

LEAST_AGREEING, LEAST_INSIDE = 0.4, 0.7
# what (score, share agreeing) may fall below the usual: to learn from, to be found again, to be followed
TO_LEARN, TO_RETURN, TO_FOLLOW = np.array([0.06, 0.08]), np.array([0.15, 0.2]), np.array([0.3, 0.4])
NEW_SLACK = 1.0  # of a new target, whose box still holds what is around it
GATE_SIGMAS, GATE_SIZE = 3.5, 0.1  # how far from the prediction a fix may be: sigmas, and share of the target's size
# a find so close to the prediction (sigmas), so soon after it was lost, need not look so good where the scene behind it
# looks quite different
EXPECTED_SIGMAS, EXPECTED_S = 2.0, 1.0
SURE, VERY_SURE = np.array([0.3, 0.6]), np.array([0.5, 0.3])
TO_RETURN_SURE = np.array([0.3, 0.25])
FOLLOW_ODDS, RETURN_ODDS, SURE_ODDS, VERY_SURE_ODDS = 1.0, 1.5, 2.0, 5.0  # of target against scene
ODDS_MERIT, AWAY_DEMERIT, FIX_PX = 0.3, 0.03, 0.6  # of the odds' logarithm; of the distance in sigmas, squared


def holds(target: TrackState, found: Alignment, scene: Scene, least_score: float, slack: Floats) -> bool:
    """Verification: it is where the target can be, it looks like the target, and not like the scene behind it."""
    if not can_be_there(target, found):
        return False
    score, agreeing = (target.usual - TO_LEARN).tolist()
    if not target.hidden and found.score >= max(least_score, score) and found.agreeing >= max(LEAST_AGREEING, agreeing):
        return True
    seen = np.array([found.score, found.agreeing])
    odds = odds_against_scene(target, found, scene, 1.5 * LEAST_AWAY_PX if target.hidden else LEAST_AWAY_PX)
    whole, partly = odds or (1.0, math.inf)
    if partly < (RETURN_ODDS if target.hidden else FOLLOW_ODDS):
        return False
    least = np.maximum([least_score, LEAST_AGREEING], target.usual - slack * (NEW_SLACK if target.new else 1.0))
    if whole > SURE_ODDS:
        near = _expected(target, found) and not target.pending
        if near:
            least = np.minimum(least, VERY_SURE if whole > VERY_SURE_ODDS else SURE)
        elif not target.hidden:
            least = np.minimum(least, target.usual - TO_RETURN_SURE)
    return bool(np.all(seen >= least))


def can_be_there(target: TrackState, found: Alignment) -> bool:
    """Whether a target can have come there and look that large; most of it has to be in the image."""
    size, scale = target.template.size, found.warp.scale
    return (
        found.inside >= LEAST_INSIDE
        and _off_px(target, found) < GATE_SIGMAS * math.hypot(target.course.sigma_px, FIX_PX) + GATE_SIZE * size * scale
        and 0.7 < scale / target.scale < 1.4
    )


def _off_px(target: TrackState, found: Alignment) -> float:
    """How far from where it was predicted a target was found."""
    return math.dist(found.warp.centre_px.tolist(), target.course.position_px.tolist())


def _expected(target: TrackState, found: Alignment) -> bool:
    """Whether it is just where it was expected, and was seen not long ago."""
    near = _off_px(target, found) < EXPECTED_SIGMAS * target.course.sigma_px + 0.5
    return near and target.lost_s < EXPECTED_S - INSTANT_S


def merit(target: TrackState, found: Alignment, scene: Scene) -> float:
    """What speaks for one of several alignments: its look, its odds against the scene, its nearness."""
    odds = odds_against_scene(target, found, scene, LEAST_AWAY_PX)
    off = _off_px(target, found)
    told = 0.0 if odds is None else ODDS_MERIT * math.log(min(max(odds[0], 0.3), 10.0))
    return found.score + told - AWAY_DEMERIT * (off / math.hypot(target.course.sigma_px, FIX_PX)) ** 2
