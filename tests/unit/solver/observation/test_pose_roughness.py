"""What is new in every frame shows in measured poses; what lasts, and how a camera flies, does not."""

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.records import PoseTrack
from pipeline.solver.observation.pose_roughness import roughness

RATE = 25.0


def flown(n: int = 400, attitude_rad: float = 0.0, position_m: float = 0.0, seed: int = 1) -> PoseTrack:
    """A camera in a bend at 10 m/s that turns with it, with white errors."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    place = np.stack([100 * np.cos(t / 10), 100 * np.sin(t / 10), 50 + 0 * t], axis=1)
    turn = np.stack([0 * t, 0 * t, t / 10], axis=1)
    q = rotation.multiply(rotation.exp(turn), rotation.exp(attitude_rad * rng.normal(size=(n, 3))))
    return PoseTrack(
        camera="a", frame=np.arange(n), time_s=t, enu_from_cam=q,
        position_enu_m=place + position_m * rng.normal(size=(n, 3)),
    )  # fmt: skip


def test_white_errors_are_found_with_their_sigma() -> None:
    turn, move = roughness(flown(attitude_rad=0.01, position_m=1.0))
    assert turn == pytest.approx(0.01, rel=0.15)
    assert move == pytest.approx(1.0, rel=0.15)


def test_a_bend_is_no_noise() -> None:
    turn, move = roughness(flown())
    assert turn < 1e-4
    assert move < 0.05


def test_errors_that_last_are_no_noise() -> None:
    """A walk of 1 m in 10 s: 0.25 m and less in the time that is looked at."""
    smooth = flown(n=1000)
    steps = np.random.default_rng(2).normal(size=(1000, 3)) * np.sqrt(1 / 10 / RATE)
    walked = PoseTrack(
        camera="a", frame=smooth.frame, time_s=smooth.time_s, enu_from_cam=smooth.enu_from_cam,
        position_enu_m=smooth.position_enu_m + np.cumsum(steps, axis=0),
    )  # fmt: skip
    assert 0.05 < roughness(walked)[1] < 0.2


def test_too_few_frames_tell_nothing() -> None:
    assert roughness(flown(n=15)) is None
    assert roughness(flown(n=25)) is None
