"""Errors of tracked centres that last from frame to frame: what the robust covariance makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.validation.check_correlated_errors import ERRORS, POSES, Errors, ratios

RUNS = 60


@pytest.mark.parametrize("grade", POSES)
@pytest.mark.parametrize("words", ["as on held-out scenes", "as on data/flight"])
def test_robust_sigmas_hold_for_errors_like_the_trackers(words, grade):
    found = ratios(ERRORS[words], POSES[grade], RUNS)
    assert 0.7 < found.offset_robust < 1.2  # 60 offsets: 0.09 either way is chance
    assert 0.8 < found.position_robust < 1.2


def test_longer_lasting_errors_are_allowed_for_in_part():
    found = ratios(ERRORS["lasting a second"], POSES["RTK"], RUNS)
    assert found.offset_robust < 0.55 * found.offset_plain
    assert found.position_robust < 0.75 * found.position_plain


def test_errors_have_the_parts_they_were_given():
    rng = np.random.default_rng(1)
    drawn = np.array([Errors(rest=0.2, new=0.3, lasts_frames=10).drawn(400, rng) for _ in range(40)])
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(0.2, rel=0.05)
    later = np.mean(drawn[:, 5:] * drawn[:, :-5]) / np.mean(drawn**2)
    assert later == pytest.approx(0.7 * np.exp(-0.5), abs=0.05)
    constant = np.array([Errors(constant=0.3, rest=0.0).drawn(5, rng) for _ in range(400)])
    assert np.sqrt(np.mean(constant**2)) == pytest.approx(0.3, rel=0.1)
    assert np.ptp(constant, axis=1).max() == pytest.approx(0.0)
    line = np.array([Errors(line=0.3, rest=0.0).drawn(101, rng) for _ in range(400)])
    assert np.sqrt(np.mean(line**2)) == pytest.approx(0.3, rel=0.1)
    assert np.abs(line.mean(axis=1)).max() < 1e-12
