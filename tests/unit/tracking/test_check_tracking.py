"""What the check of tracking says about errors that last: autocorrelation and parts, on errors made to order."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.validation.check_tracking import correlation, parts, without_mean

FRAMES, CARS = 400, 30


def errors(rng: np.random.Generator, *, stays: float = 0.9, mean: float = 0.0) -> list[np.ndarray]:
    """First-order autoregressive errors of unit variance, each car about its own mean, a tenth of the frames unseen."""
    found = []
    for _ in range(CARS):
        value = rng.normal(size=(FRAMES, 2))
        for f in range(1, FRAMES):
            value[f] = stays * value[f - 1] + np.sqrt(1 - stays**2) * value[f]
        value += mean * rng.normal(size=2)
        value[rng.random(FRAMES) < 0.1] = np.nan
        found.append(value)
    return found


@pytest.mark.parametrize("lag", [1, 5, 25])
def test_autocorrelation_is_that_of_the_process(lag):
    assert correlation(errors(np.random.default_rng(1)), lag) == pytest.approx(0.9**lag, abs=0.06)


def test_a_constant_of_each_car_counts_until_its_mean_is_taken_out():
    series = errors(np.random.default_rng(2), stays=0.0, mean=1.0)
    assert correlation(series, 25) == pytest.approx(0.5, abs=0.15)
    assert correlation([without_mean(s) for s in series], 25) == pytest.approx(0.0, abs=0.03)


def test_parts_are_told_apart():
    rng = np.random.default_rng(3)
    series = []
    for _ in range(CARS):
        ramp = np.linspace(-1, 1, FRAMES)[:, None]
        value = 0.5 * rng.choice([-1, 1], 2) + 0.6 * rng.choice([-1, 1], 2) * ramp + 0.1 * rng.normal(size=(FRAMES, 2))
        value[100:140] = np.nan
        series.append(value)
    found = parts(series)
    assert found["constant"] == pytest.approx(0.5, rel=0.05)
    assert found["on a line"] == pytest.approx(0.6 / np.sqrt(3), rel=0.05)
    assert found["rest"] == pytest.approx(0.1, rel=0.05)
    assert found["new in every frame, at most"] == pytest.approx(0.1, rel=0.05)
