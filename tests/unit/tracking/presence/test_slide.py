"""Whether a track has slid onto the scene: by how it moves, and by what is seen where it was."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.tracking.presence.slide import Trail, carried_trail, extended, first_trail, has_slid, stopped
from pipeline.tracking.scene.background import Keyframe, Scene

RATE_HZ, SPEED_PX, SIZE = 10.0, 4.0, np.array([24.0, 16.0])
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
    trail, _, told = followed(ground, stays=True)
    assert not any(told)
    assert trail.suspicious >= 3
    assert stopped(trail).suspicious in (0, trail.suspicious)


def test_where_nothing_else_tells_a_doubtful_look_decides(ground) -> None:
    trail, scene, _ = followed(ground, stays=True)
    blind = Scene(
        frame=scene.frame, time_s=scene.time_s, pixels=scene.pixels, dt_s=scene.dt_s, cur_from_prev=PAN, keys=()
    )
    assert has_slid(trail, blind, SIZE, doubtful=True)
    assert not has_slid(trail, blind, SIZE, doubtful=False)


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


def test_a_box_that_comes_to_rest_little_by_little_is_no_target_that_slows_down(ground) -> None:
    alone, surface = slowing(ground, by_box=True), slowing(ground, by_box=False)
    assert alone.certain < 20
    assert alone.suspicious > 2
    assert np.hypot(*surface.velocity) < 0.8 * np.hypot(*alone.velocity)
