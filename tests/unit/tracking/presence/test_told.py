"""Small targets against the scene: what went out of a box that stands, and what was on the scene there before."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.tracking.presence.slide import Trail, extended, first_trail
from pipeline.tracking.presence.told import doubted_since, not_there, told
from pipeline.tracking.scene.background import Scene

SIZE, PLACE = np.array([12.0, 8.0]), np.array([60.0, 50.0])
STEP_S = 0.1


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    coarse = np.random.default_rng(5).uniform(60, 190, (25, 50, 3)).astype(np.float32)
    return cv2.resize(coarse, (200, 100), interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)


def picture(ground: np.ndarray, car: np.ndarray) -> np.ndarray:
    """A car of 12 x 8 px behind a post that stands in the middle of its first box."""
    shown = ground.copy()
    x, y = np.rint(car - (SIZE - 1) / 2).astype(int)
    shown[y : y + 8, x : x + 12] = (30, 40, 220)
    shown[y + 2 : y + 6, x + 2 : x + 5] = (240, 240, 240)
    shown[40:60, 59:62] = (20, 20, 20)
    return shown


def tracked(pictures: list[np.ndarray], places: list[np.ndarray]) -> tuple[Trail, Scene]:
    """A track that says it is at the places, in pictures whose background stands still, judged up to the last."""
    trail, scene = first_trail(0, 0.0, places[0]), None
    for frame in range(1, len(pictures)):
        scene = Scene(
            frame=frame, time_s=frame * STEP_S, dt_s=STEP_S, pixels=pictures[frame], cur_from_prev=np.eye(3), keys=()
        )
        trail = extended(trail, scene, places[frame], float(np.sqrt(SIZE.prod())), False)
        trail = told(trail, scene, SIZE)
    assert scene is not None
    return trail, scene


def test_a_post_that_the_car_has_left_is_not_the_car(ground) -> None:
    cars = [PLACE + np.array([0.8 * frame, 0.0]) for frame in range(24)]
    trail, scene = tracked([picture(ground, car) for car in cars], [PLACE] * 24)
    assert not_there(trail, scene)
    since = doubted_since(trail, scene)
    assert since is not None
    assert 2 <= since < 10


def test_a_parked_car_is_there(ground) -> None:
    rng = np.random.default_rng(6)
    still = picture(ground, PLACE).astype(float)
    noisy = [(still + rng.normal(0, 4, still.shape)).clip(0, 255).astype(np.uint8) for _ in range(24)]
    trail, scene = tracked(noisy, [PLACE] * 24)
    assert not not_there(trail, scene)
    assert doubted_since(trail, scene) is None


def test_a_car_that_is_followed_is_there(ground) -> None:
    cars = [PLACE + np.array([0.8 * frame, 0.0]) for frame in range(40)]
    trail, scene = tracked([picture(ground, car) for car in cars], cars)
    assert not not_there(trail, scene)


def test_what_the_scene_held_there_before_the_target_came_is_not_the_target(ground) -> None:
    """The track goes with the car, then creeps over the ground like parallax, so that its way tells nothing."""
    cars = [PLACE + np.array([2.0 * frame, 0.0]) for frame in range(40)]
    places = [*cars[:12], *(cars[12] + np.array([0.5 * k, 6.0]) for k in range(28))]
    trail, scene = tracked([picture(ground, car) for car in cars], places)
    assert trail.behind is not None
    assert not_there(trail, scene)
