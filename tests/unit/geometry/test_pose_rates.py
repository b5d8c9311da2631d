"""Rates of poses: of motions whose rates are known, with noise and without, at the ends and over gaps."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.geometry.pose_rates import pose_rates

RATE = np.array([0.1, -0.35, 0.05])
VELOCITY = np.array([3.0, -8.0, 1.0])


def turning(time_s):
    """Poses that turn at RATE and move at VELOCITY; the first looks somewhere."""
    first = rotation.exp(np.array([0.4, -1.0, 0.3]))
    cam_from_enu = rotation.multiply(rotation.exp(time_s[:, None] * RATE), first)
    return rotation.conjugate(cam_from_enu), time_s[:, None] * VELOCITY


@pytest.mark.parametrize("count", [1, 2, 3, 4, 200])
def test_steady_rates_are_exact(count):
    time = np.arange(count) / 25.0
    found = pose_rates(time, *turning(time))
    wanted = np.tile([*RATE, *VELOCITY], (count, 1)) if count > 1 else np.zeros((1, 6))
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_the_sign_is_that_of_the_pose_going_on():
    time = np.arange(50) / 25.0
    attitude, _ = turning(time)
    rate = pose_rates(time, attitude, np.zeros((50, 3)))[20, :3]
    later = rotation.multiply(rotation.exp(0.04 * rate), rotation.conjugate(attitude[20]))
    np.testing.assert_allclose(np.abs((later * rotation.conjugate(attitude[21])).sum()), 1.0, atol=1e-9)


def test_a_camera_that_swings_keeps_its_rate():
    """20 degrees/s at most, with a period of 2 s, and a fifth of a degree new in every frame."""
    time = np.arange(500) / 25.0
    swing, most = np.pi * time, np.radians(20)
    cam_from_enu = rotation.exp(np.outer(most / np.pi * np.sin(swing), [0, 1.0, 0]))
    true = most * np.cos(swing)
    quiet = pose_rates(time, rotation.conjugate(cam_from_enu), np.zeros((500, 3)))[:, 1]
    assert np.abs(quiet - true)[5:-5].max() < 0.01 * most
    rng = np.random.default_rng(0)
    noisy = rotation.multiply(rotation.exp(np.radians(0.2) * rng.normal(size=(500, 3))), cam_from_enu)
    found = pose_rates(time, rotation.conjugate(noisy), np.zeros((500, 3)))[:, 1]
    assert np.degrees((found - true)[10:-10].std()) < 1.2
    assert (found * true).sum() / (true**2).sum() == pytest.approx(1, abs=0.015)


def test_gaps_are_not_bridged():
    """What lies 10 s further says nothing of here."""
    time = np.concatenate([np.arange(20), np.arange(20) + 250]) / 25.0
    attitude, place = turning(time)
    place[20:] += 1000.0
    found = pose_rates(time, attitude, place)
    np.testing.assert_allclose(found, np.tile([*RATE, *VELOCITY], (40, 1)), atol=0.1)


def test_still_and_simultaneous_poses_have_no_rate():
    assert not pose_rates(np.arange(5.0), np.tile([1.0, 0, 0, 0], (5, 1)), np.ones((5, 3))).any()
    assert not pose_rates(np.zeros(5), *turning(np.arange(5.0))).any()
