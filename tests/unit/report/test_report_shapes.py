"""Ellipses, labels, thinning and state_intervals: what the figures are made of."""

from __future__ import annotations

import dataclasses
import re
from itertools import pairwise

import numpy as np
import pytest

from pipeline.records import LOST, REACQUIRED, TRACKED
from pipeline.report.charts.ellipses import ellipse_path, enlargement
from pipeline.report.charts.placing import place
from pipeline.report.data import participants
from pipeline.report.data.visibility import losses, state_intervals, times_seen
from tests.scenes.report import fake_results

SIGHTING_ARRAYS = ("time_s", "residual_px", "residual_sigma", "position_enu_m")


def test_an_ellipse_has_the_axes_of_its_covariance():
    d = ellipse_path(np.array([10.0, 20.0]), np.array([[9.0, 0.0], [0.0, 4.0]]), 2)
    x0, y0, major, minor, angle = map(float, re.match(r"M(\S+) (\S+)a(\S+) (\S+) (\S+)", d).groups())
    assert (major, minor) == (6.0, 4.0)
    assert angle % 180 == 0
    assert abs(x0 - 10) == 6
    assert y0 == 20


def test_no_ellipse_without_a_covariance():
    assert ellipse_path(np.zeros(2), np.full((2, 2), np.nan)) == ""


def test_enlargement_is_round_and_fits():
    tracks = fake_results().trajectories
    assert enlargement(tracks, 1.5, 12.0) in (10, 20)
    assert enlargement(tracks, 1000.0, 12.0) == 1
    assert enlargement([], 1.0, 12.0) == 1


def test_names_keep_apart_and_inside():
    crowd = [(50.0, 50.0, "first"), (52.0, 50.0, "second"), (395.0, 50.0, "at the edge")]
    (_, y0, a0), (_, y1, a1), (_, _, edge) = place(crowd, 400, 100)
    assert (y0, a0) != (y1, a1)
    assert edge == "end"


@pytest.mark.parametrize(("n", "limit"), [(10, 20), (1000, 7), (2, 1), (0, 5)])
def test_thinning_keeps_both_ends(n, limit):
    at = participants.thinned(n, limit)
    assert len(at) <= max(limit, n and 1)
    assert len(set(at)) == len(at)
    if n and limit > 1:
        assert (at[0], at[-1]) == (0, n - 1)


def test_spells_follow_the_states():
    results = fake_results()
    track = results.tracks[0]
    found = state_intervals(results, track)
    assert [s.state for s in found] == [TRACKED, LOST, REACQUIRED]
    assert all(a.end_s == b.start_s for a, b in pairwise(found))
    assert losses(results, track.target) == 2
    assert len(times_seen(results, track.camera, track.target)) == 2


def test_a_target_that_is_never_found_again_was_not_lost_and_found():
    results = fake_results()
    track = results.tracks[0]
    for states, count in (([TRACKED, LOST, LOST], 0), ([LOST, TRACKED, LOST], 1), ([LOST, TRACKED, TRACKED], 1)):
        state = np.repeat(states, -(-len(track.frame) // 3))[: len(track.frame)]
        xy = np.where((state == LOST)[:, None], np.nan, np.zeros((len(state), 2)))
        alone = dataclasses.replace(track, state=state, xy_px=xy)
        assert losses(dataclasses.replace(results, tracks=(alone,)), track.target) == count


def test_a_gap_in_the_frames_is_a_loss():
    results = fake_results()
    track = results.tracks[0]
    keep = np.r_[0:50, 90:120]
    cut = dataclasses.replace(
        track,
        **{k: getattr(track, k)[keep] for k in ("frame", "time_s", "xy_px", "sigma_px", "box")},
        state=np.zeros(len(keep), int),
    )
    found = state_intervals(results, cut)
    assert [s.state for s in found] == [TRACKED, LOST, REACQUIRED]
    assert found[1].start_s == pytest.approx(49 / 25)
    assert found[1].end_s == pytest.approx(90 / 25)


def test_frames_are_placed_by_clock_and_container():
    results = fake_results(drift=False)
    late = tuple(dataclasses.replace(t, time_s=t.time_s + 0.5) for t in results.tracks)
    moved = dataclasses.replace(results, tracks=late)
    frames = np.array([0, 100])
    clock = results.solution.clock("uav2")
    assert participants.frame_times(results, "uav2", frames) == pytest.approx(clock.common_time_s(frames / 25))
    assert participants.frame_times(moved, "uav2", frames) == pytest.approx(clock.common_time_s(frames / 25 + 0.5))


def test_what_nobody_saw_is_not_well_known():
    results = fake_results()
    s = results.solution.sightings
    keep = (s.time_s < 8) | (s.time_s > 12)
    cut = dataclasses.replace(
        s,
        camera=tuple(c for c, k in zip(s.camera, keep, strict=True) if k),
        target=tuple(t for t, k in zip(s.target, keep, strict=True) if k),
        **{
            k: getattr(s, k)[keep]
            for k in ("frame", "time_s", "residual_px", "residual_sigma", "weight", "position_enu_m")
        },
    )
    gone = dataclasses.replace(results, solution=dataclasses.replace(results.solution, sightings=cut))
    track = results.trajectories[0]
    known = participants.well_known(gone, track)
    assert participants.well_known(results, track).all()
    assert not known[(track.time_s > 9.1) & (track.time_s < 10.9)].any()
    assert known[(track.time_s < 8) | (track.time_s > 12)].all()


def test_a_wide_sigma_is_not_well_known():
    results = fake_results()
    track = results.trajectories[0]
    factor = np.where(track.time_s > 15, 100.0, 1.0)
    wide = dataclasses.replace(track, covariance=track.covariance * factor[:, None, None])
    known = participants.well_known(results, wide)
    assert known[track.time_s <= 15].all()
    assert not known[track.time_s > 15].any()
