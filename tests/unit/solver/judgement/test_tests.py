"""The figures that the verdict rests on follow the laws that they claim."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from pipeline.geometry import rotation
from pipeline.solver.judgement.depth import interval
from pipeline.solver.judgement.pose_sequences import pose_sequences
from pipeline.solver.judgement.prior_tests import log10_chance, whitened_square
from pipeline.solver.judgement.words import mount_words
from pipeline.solver.observation.pose_wander import wander_knots
from tests.scenes.solver import changed, rich_model


@pytest.mark.parametrize(("statistic", "freedom"), [(0.5, 1), (12.0, 3), (300.0, 6), (1400.0, 3)])
def test_chances_are_those_of_chi_square(statistic: float, freedom: int) -> None:
    assert log10_chance(statistic, freedom) == pytest.approx(chi2.logsf(statistic, freedom) / math.log(10), rel=1e-2)


def test_a_chance_too_small_for_a_number_is_still_a_number() -> None:
    assert -3e4 < log10_chance(1e5, 3) < -2e4
    assert log10_chance(1e6, 3) < log10_chance(1e5, 3)
    assert np.isfinite(log10_chance(math.inf, 3))


def test_corrections_are_whitened() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    variance = root @ root.T
    drawn = rng.normal(size=(2000, 3)) @ root.T
    square = np.array([whitened_square(d, variance) for d in drawn])
    assert square.mean() == pytest.approx(3, abs=0.2)
    assert whitened_square(np.array([1.0, 0, 0]), np.zeros((3, 3)), floor=0.5) == pytest.approx(2.0)


def test_depth_intervals_hold_where_the_parallax_is_normal() -> None:
    rng = np.random.default_rng(1)
    true, spread = 360.0, 0.25 / 360.0
    parallax = 1 / true + spread * rng.normal(size=4000)
    found = 1 / parallax[parallax > 0.2 / true]
    inside = [low <= true <= high for low, high in (interval(r, spread * r**2, 1.95996) for r in found)]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)


def test_a_depth_may_have_no_upper_end() -> None:
    low, high = interval(100.0, 60.0, 1.95996)
    assert high == math.inf
    assert 40 < low < 50


@pytest.mark.parametrize(
    ("given_deg", "true_deg", "said"),
    [
        ((3.0, -38.0, 1.0), (3.0, -38.0, 1.0), "pitch_deg = -38.0"),
        ((0.0, 0.0, 0.0), (2.0, -35.0, 0.0), "none was given"),
        ((0.0524, -0.6632, 0.01745), (3.0, -38.0, 1.0), "taken for radians"),
        ((0.0, 30.0, 0.0), (0.0, -30.0, 0.0), "the other sign"),
        ((10.0, -30.0, 0.0), (25.0, -30.0, 0.0), "yaw_deg = 25.0 }"),
    ],
)
def test_the_mount_that_the_pictures_fit_is_said(
    given_deg: tuple[float, ...], true_deg: tuple[float, ...], said: str
) -> None:
    ned = rotation.ned_from_frd(np.array(0.4), np.array(0.05), np.array(-0.1))
    given, true = (
        rotation.enu_from_cam(ned, rotation.ned_from_frd(*(np.array(a) for a in np.radians(d))))
        for d in (given_deg, true_deg)
    )
    turn = rotation.log(rotation.multiply(rotation.conjugate(true), given))
    yaw, pitch, roll = np.radians(given_deg)
    words = mount_words((float(yaw), float(pitch), float(roll)), turn)
    assert said in words
    assert ("radians" in words) == (said == "taken for radians")


@pytest.mark.parametrize("lasting", [False, True])
def test_errors_that_are_taken_to_last_are_not_called_alike_again(lasting: bool) -> None:
    model, state = rich_model(drift=False)
    slow = np.sin(np.linspace(0, 9, len(state.own)))[:, None] * np.ones(6)
    state = changed(state, own=slow)
    if lasting:
        sigma = np.zeros((2, 6))
        sigma[0] = 0.01
        model = model.changed(wander=wander_knots(model.frames, sigma, np.full((2, 6), 2.0)))
        state = changed(state, wander=np.zeros((model.wander.count, 6)))
    alike = {s.camera for s in pose_sequences(model, state) if s.kind == "alike"}
    cameras = set(model.frames.cameras)
    assert alike == (cameras - {model.frames.cameras[0]} if lasting else cameras)
