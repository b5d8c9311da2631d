"""Whether a track has slid onto the scene: by how it moves, and by what is seen where it was."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.tracking.presence.slide import (
    Trail,
    carried_trail,
    extended,
    first_trail,
    has_slid,
    proved,
    scene_or_target,
)
from pipeline.tracking.scene.background import Keyframe, Scene
from pipeline.tracking.settings import SLIDE

RATE_HZ, SPEED_PX, SIZE = 10.0, 4.0, np.array([24.0, 16.0])
ASIDE = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 6.0], [0.0, 0.0, 1.0]])
PAN = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # the background, from frame to frame


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    rng = np.random.default_rng(3)
    coarse = rng.uniform(30, 220, (40, 120, 3)).astype(np.float32)
    return cv2.resize(coarse, (600, 200), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def picture(ground: np.ndarray, frame: int, place: np.ndarray | None) -> np.ndarray:
    """The panned ground, with a target at a place where there is one."""
    shown = ground[:, 200 - 2 * frame : 500 - 2 * frame].copy()
    if place is not None:
        x, y = np.rint(place - (SIZE - 1) / 2).astype(int)
        shown[y : y + 16, x : x + 24] = (20, 40, 230)
        shown[y + 4 : y + 12, x + 6 : x + 18] = (240, 230, 30)
    return shown


def followed(ground: np.ndarray, stays: bool, slides_at: int = 14, frames: int = 20) -> tuple[Trail, Scene, list[bool]]:
    """A target over a panning ground; from a frame on the track stands on the ground, with the target or without it."""
    true, track = np.array([60.0, 100.0]), np.array([60.0, 100.0])
    trail, keys, told = (
        first_trail(0, 0.0, track),
        [Keyframe(pixels=picture(ground, 0, true), cur_from_key=np.eye(3), age=0)],
        [],
    )
    scene = None
    for frame in range(1, frames):
        moves = np.array([SPEED_PX, 0.0]) if frame < slides_at else np.zeros(2)
        track = track + np.array([2.0, 0.0]) + moves
        true = track if stays or frame < slides_at else true + np.array([2.0 + SPEED_PX, 0.0])
        pixels = picture(ground, frame, true)
        keys = [Keyframe(pixels=k.pixels, cur_from_key=PAN @ k.cur_from_key, age=k.age + 1) for k in keys]
        scene = Scene(
            frame=frame, time_s=frame / RATE_HZ, pixels=pixels, dt_s=1 / RATE_HZ, cur_from_prev=PAN, keys=tuple(keys)
        )
        trail = extended(carried_trail(trail, scene), scene, track, float(np.sqrt(SIZE.prod())), False)
        told.append(has_slid(trail, scene, SIZE, False))
        if frame % 6 == 0:
            keys = [Keyframe(pixels=pixels, cur_from_key=np.eye(3), age=0), *keys[:3]]
    assert scene is not None
    return trail, scene, told


def test_a_target_that_goes_on_is_certain(ground) -> None:
    trail, _, told = followed(ground, stays=True, slides_at=99)
    assert not any(told)
    assert trail.certain >= 15
    np.testing.assert_allclose(trail.velocity, [SPEED_PX * RATE_HZ, 0.0], atol=0.5)


def test_a_track_that_stands_on_the_ground_has_slid(ground) -> None:
    trail, _, told = followed(ground, stays=False)
    assert not any(told[:13])
    assert any(told[13:])
    assert trail.certain < 14


def test_a_target_that_stops_has_not_slid(ground) -> None:
    trail, _, told = followed(ground, stays=True, frames=24)
    assert not any(told)
    assert told[-1] is False
    assert trail.suspicious >= 3
    rested = proved(trail)
    assert rested.certain == trail.frame[-1]
    assert np.hypot(*rested.velocity) < 0.8 * np.hypot(*trail.velocity)


def blind(trail: Trail, scene: Scene) -> tuple[Trail, Scene]:
    """The same where no earlier picture is left to compare with."""
    return replace(trail, pasts=()), replace(scene, keys=())


def test_where_nothing_else_tells_a_doubtful_look_decides(ground) -> None:
    trail, scene, _ = followed(ground, stays=True, slides_at=15)
    trail, scene = blind(trail, scene)
    assert trail.suspicious < SLIDE.stop_frames
    assert has_slid(trail, scene, SIZE, doubtful=True)
    assert not has_slid(trail, scene, SIZE, doubtful=False)


def test_a_small_target_that_nothing_tells_from_the_scene_is_lost(ground) -> None:
    trail, scene = blind(*followed(ground, stays=True, frames=24)[:2])
    assert trail.suspicious >= SLIDE.stop_frames
    assert has_slid(trail, scene, SIZE, doubtful=False)
    assert has_slid(trail, scene, 2.0 * SIZE, doubtful=False) is False


def test_a_slide_after_its_first_half_second_is_seen_in_the_first_picture(ground) -> None:
    """What slid so soon was never a whole target's length away from the scene in any of the scene's own frames."""
    trail, scene, told = followed(ground, stays=False, slides_at=8, frames=34)
    assert any(told[8:])
    assert not any(told[:8])
    assert len(trail.pasts) >= 2
    assert trail.pasts[0].frame == 1
    alone = scene_or_target(trail, replace(scene, keys=()), SIZE, trail.own_px[-1])
    assert alone is not None
    assert alone[0] > alone[1] + SLIDE.margin


def test_parallax_does_not_hide_where_the_scene_was_before(ground) -> None:
    """A tree that is nearer than the ground is not where the ground's motion leads; it is found beside that."""
    trail, scene, _ = followed(ground, stays=False)
    pasts = tuple(replace(p, cur_from_past=ASIDE @ p.cur_from_past) for p in trail.pasts)
    off, scene = replace(trail, pasts=pasts), replace(scene, keys=())
    told = scene_or_target(off, scene, SIZE, off.own_px[-1])
    assert told is not None
    assert told[0] > told[1] + SLIDE.margin


def slowing(ground: np.ndarray, by_box: bool) -> Trail:
    """A track over still ground that comes to rest little by little after a second."""
    still, place, speed = np.eye(3), np.array([60.0, 100.0]), 4.0
    trail = first_trail(0, 0.0, place)
    for frame in range(1, 45):
        speed *= 1.0 if frame < 12 else 0.8
        place = place + np.array([speed, 0.0])
        scene = Scene(
            frame=frame, time_s=frame / RATE_HZ, pixels=ground, dt_s=1 / RATE_HZ, cur_from_prev=still, keys=()
        )
        trail = extended(carried_trail(trail, scene), scene, place, float(np.sqrt(SIZE.prod())), by_box)
    return trail


@pytest.mark.parametrize("by_box", [True, False])
def test_what_comes_to_rest_little_by_little_is_not_believed_to_slow_down(ground, by_box) -> None:
    trail = slowing(ground, by_box)
    assert trail.certain < 20
    assert trail.slow > SLIDE.stop_frames
    np.testing.assert_allclose(trail.velocity, [4.0 * RATE_HZ, 0.0], rtol=0.15)
