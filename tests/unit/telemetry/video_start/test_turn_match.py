"""The start of a video, found by turning: right, with a sigma that is true, and refused where nothing tells."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from pipeline.telemetry import GRID_S, LogTurning, match_turns

BEGIN_S, LOG_S = 50.0, 90.0
SHIFT_RHO = 1 / 140


def wander(rng, n, memory_s):
    return gaussian_filter1d(rng.normal(size=(n, 3)), memory_s / GRID_S, axis=0) * np.sqrt(memory_s / GRID_S)


def flight(seed, *, start_s=31.237, turning=0.03, log_noise=0.002, stretch=0.0, repeat_s=None):
    """Turns of a video that began `start_s` into the log, and the log with its own noise."""
    rng = np.random.default_rng(seed)
    n = round(LOG_S / GRID_S)
    rate = turning * wander(rng, n, 0.4)
    if repeat_s is not None:
        period = round(repeat_s / GRID_S)
        rate = np.tile(rate[:period], (n // period + 1, 1))[:n]
    shift = (5.0 if repeat_s is None else 0.0) * wander(rng, n, 3.0)
    stamps, step = GRID_S * np.arange(n + 1), 1 / 25
    whole = [np.concatenate([np.zeros((1, 3)), np.cumsum(GRID_S * part, axis=0)]) for part in (rate, shift)]
    video = step * np.arange(25 * 14 + 1)
    true = start_s + video * (1 + stretch)
    turned, moved = (
        np.diff(np.stack([np.interp(true, stamps, column) for column in part.T], axis=1), axis=0) for part in whole
    )
    seen = turned + SHIFT_RHO * moved + 5e-5 * rng.normal(size=turned.shape) + 1e-4
    log = LogTurning(begin_s=BEGIN_S, rate_radps=rate + log_noise * wander(rng, n, 0.15), shift_mps=shift)
    return video, seen, log


def test_the_start_is_found_and_its_sigma_is_true():
    ratio = []
    for seed in range(20):
        match = match_turns(*flight(seed, stretch=1e-4 * (seed - 10) / 5))
        assert match.certain, seed
        best = match.candidates[0]
        assert abs(best.start_s - BEGIN_S - 31.237) < 0.02, seed
        ratio.append((best.start_s - BEGIN_S - 31.237) / best.sigma_s)
    assert 0.4 < np.sqrt(np.mean(np.square(ratio))) < 1.4


def test_unseen_frames_and_gaps_in_the_log_are_left_out():
    video, seen, log = flight(3)
    seen[100:130] = np.nan
    rate = np.array(log.rate_radps)
    rate[round(20 / GRID_S) : round(24 / GRID_S)] = np.nan
    match = match_turns(video, seen, LogTurning(begin_s=BEGIN_S, rate_radps=rate, shift_mps=log.shift_mps))
    assert match.certain
    assert match.candidates[0].start_s == pytest.approx(BEGIN_S + 31.237, abs=0.02)


def test_a_still_camera_is_refused():
    match = match_turns(*flight(1, turning=0.0))
    assert not match.certain


def test_a_video_of_another_flight_is_refused():
    video, seen, _ = flight(1)
    assert not match_turns(video, seen, flight(2)[2]).certain


def test_a_flight_that_repeats_itself_has_several_candidates():
    match = match_turns(*flight(4, repeat_s=30.0))
    assert not match.certain
    starts = [c.start_s - BEGIN_S for c in match.candidates]
    assert len(starts) >= 2
    assert min(abs(s - 31.237) for s in starts) < 0.02
    assert min(abs(s - 1.237) for s in starts) < 0.02


def test_a_log_shorter_than_the_video_has_no_candidate():
    video, seen, log = flight(1)
    short = LogTurning(begin_s=0.0, rate_radps=log.rate_radps[:300], shift_mps=log.shift_mps[:300])
    assert match_turns(video, seen, short).candidates == ()
