"""A target against the scene behind it: which of its pixels are its own, where it explains the picture better."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import pytest

from pipeline.tracking.following.follow import _rotation, _turned
from pipeline.tracking.presence.scene_behind import aligned, odds_against_scene
from pipeline.tracking.scene.background import Keyframe, Scene
from pipeline.tracking.target.alignment import align
from pipeline.tracking.target.kinematics import Course
from pipeline.tracking.target.search import _log_odds, candidates
from pipeline.tracking.target.template import Template, Warp, contrasted, first_template, over_ground, sample
from pipeline.tracking.target.track_state import TrackState

SIZE, COLOUR = (200, 140), (170.0, 60.0, 150.0)
OLD, NOW = np.array([60.0, 70.0]), np.array([120.0, 66.0])


def ground(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(80, 140, (SIZE[1] // 7 + 3, SIZE[0] // 7 + 3, 3)).astype(np.float32)
    return cv2.resize(coarse, SIZE, interpolation=cv2.INTER_CUBIC)


def with_disc(picture: np.ndarray, centre: np.ndarray, radius: float = 6.0) -> np.ndarray:
    """The picture with a disc of one colour, its edge smooth to a fraction of a pixel."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    share = np.clip(radius + 0.5 - np.hypot(x - centre[0], y - centre[1]), 0, 1)[:, :, None]
    return np.clip(np.rint(picture * (1 - share) + np.array(COLOUR) * share), 0, 255).astype(np.uint8)


def learned(before: np.ndarray, bare: np.ndarray, times: int = 12) -> Template:
    """The disc's template, compared with the bare ground that was behind it."""
    template = first_template(before, OLD, (14.0, 14.0))
    start = Warp(linear=np.eye(2), centre_px=OLD)
    behind = sample(bare.astype(np.uint8), start, template.shape, template.step_px)
    difference = ((behind - template.pixels) ** 2).mean(axis=2)
    for _ in range(times):
        template = contrasted(template, difference, 0.3)
    return template


@pytest.fixture
def scene() -> tuple[Scene, TrackState]:
    """A disc that went from OLD to NOW over still ground, ten frames after the ground was last seen bare at NOW."""
    bare = ground(1)
    before, now = with_disc(bare, OLD), with_disc(bare, NOW)
    key = Keyframe(pixels=before, cur_from_key=np.eye(3), age=10)
    course = Course(position_px=NOW, velocity=np.array([150.0, -10.0]), covariance=np.eye(2), length_px=14.0)
    target = TrackState(template=learned(before, bare), linear=np.eye(2), course=course, coarse=None)
    return Scene(frame=10, time_s=0.4, pixels=now, dt_s=0.04, cur_from_prev=np.eye(3), keys=(key,)), target


def test_what_differs_from_the_scene_is_the_targets_own(scene) -> None:
    template = scene[1].template
    h, w = template.shape
    x, y = np.meshgrid(np.arange(w) - (w - 1) / 2, np.arange(h) - (h - 1) / 2)
    far = np.hypot(x, y) * template.step_px
    assert template.own[far < 4.5].min() > 0.9
    assert template.own[far > 8.5].max() < 0.1


def test_without_comparison_every_pixel_counts_the_same() -> None:
    template = first_template(ground(1).astype(np.uint8), OLD, (14.0, 14.0))
    assert np.all(template.own == 1.0)


def test_odds_are_for_the_target_where_it_is_and_against_it_elsewhere(scene) -> None:
    seen, target = scene
    for place, low, high in ((NOW, 5.0, np.inf), (NOW + np.array([0.0, 30.0]), 0.0, 0.2)):
        found = align(seen.pixels, target.template, Warp(linear=np.eye(2), centre_px=place), np.eye(2))
        odds = odds_against_scene(target, found, seen, 2.0)
        assert odds is not None
        assert low < odds[0] < high


def test_no_odds_before_the_target_has_moved(scene) -> None:
    seen, target = scene
    found = align(seen.pixels, target.template, Warp(linear=np.eye(2), centre_px=NOW), np.eye(2))
    still = Course(position_px=NOW, velocity=np.zeros(2), covariance=np.eye(2), length_px=14.0)
    assert odds_against_scene(TrackState(template=target.template, linear=np.eye(2), course=still, coarse=None), found,
                              seen, 2.0) is None  # fmt: skip


def test_a_plain_disc_is_aligned_by_its_outline_over_known_ground(scene) -> None:
    seen, target = scene
    found = aligned(target, seen, Warp(linear=np.eye(2), centre_px=NOW + np.array([1.6, -1.3])), 1.0)
    assert np.abs(found.warp.centre_px - NOW).max() < 0.1
    assert found.score > 0.95


def test_over_ground_shows_the_ground_beside_the_target(scene) -> None:
    template = scene[1].template
    other = np.full_like(template.pixels, 30.0)
    shown = over_ground(template, other)
    assert np.abs(shown.pixels[0, 0] - 30.0).max() < 3.0
    middle = template.shape[0] // 2, template.shape[1] // 2
    assert np.abs(shown.pixels[middle] - COLOUR).max() < 3.0
    assert np.all(shown.own == 1.0)


def test_log_odds_are_those_of_every_place_taken_alone() -> None:
    rng = np.random.default_rng(3)
    region, behind = (rng.uniform(0, 255, (17, 19, 3)).astype(np.float32) for _ in range(2))
    look, trust = rng.uniform(0, 255, (5, 6, 3)).astype(np.float32), rng.uniform(0.1, 1, (5, 6)).astype(np.float32)
    found = _log_odds(region, behind, look, trust)
    assert found.shape == (13, 14)
    weight = trust / trust.sum()
    for y, x in ((0, 0), (4, 9), (12, 13)):
        piece, bare = region[y : y + 5, x : x + 6], behind[y : y + 5, x : x + 6]
        own, away = (((piece - other) ** 2).mean(axis=2) * weight for other in (look, bare))
        assert found[y, x] == pytest.approx(0.5 * np.log((away.sum() + 25) / (own.sum() + 25)), abs=1e-3)


def test_a_plain_disc_is_found_where_correlation_has_nothing_to_hold_on_to(scene) -> None:
    seen, target = scene
    template, predicted = target.template, Warp(linear=np.eye(2), centre_px=NOW + np.array([14.0, 9.0]))
    bare = ground(1).astype(np.uint8)
    places = candidates(seen.pixels, template, predicted, 30.0, 15.0, partial(sample, bare))
    assert np.abs(places[0] - NOW).max() < 1.5


@pytest.mark.parametrize("angle", [-0.4, 0.0, 0.02, 1.2])
def test_turned_is_the_angle_beyond_the_prediction(angle: float) -> None:
    predicted = np.array([[0.9, 0.3], [-0.2, 1.1]])
    assert _turned(predicted @ _rotation(angle), predicted) == pytest.approx(angle, abs=1e-12)
