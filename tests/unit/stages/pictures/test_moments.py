"""Which moments are shown: every first fix, the longest losses, the largest residuals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.records import Box, Results
from pipeline.stages.pictures.moments import Moment, moments
from pipeline.stages.pictures.settings import PictureSettings
from tests.scenes.report import fake_results

SETTINGS = PictureSettings()


@pytest.fixture(scope="module")
def results() -> Results:
    return fake_results(targets=3, seconds=12)


def wanted(results: Results, kind: str, settings: PictureSettings = SETTINGS) -> list[Moment]:
    return [m for m in moments(results, {}, settings) if m.kind == kind]


def test_the_first_fix_of_every_track_comes_first(results):
    found = moments(results, {}, SETTINGS)
    assert [(m.camera, m.target) for m in found[:6]] == [(t.camera, t.target) for t in results.tracks]
    assert {m.kind for m in found[:6]} == {"first"}
    assert all(m.frame == t.frame[t.seen][0] for m, t in zip(found, results.tracks, strict=False))


def test_a_loss_is_shown_by_its_last_fix_and_the_first_after_it(results):
    lost, found = wanted(results, "lost"), wanted(results, "found")
    assert len(lost) == len(found) == 6
    for before, after in zip(lost, found, strict=True):
        track = next(t for t in results.tracks if (t.camera, t.target) == (before.camera, before.target))
        assert before.target == after.target
        between = (track.frame > before.frame) & (track.frame < after.frame)
        assert between.any()
        assert not track.seen[between].any()
    few = wanted(results, "lost", dataclasses.replace(SETTINGS, losses=1))
    assert [m.camera for m in few] == ["uav1", "uav2"]


def test_outliers_are_the_largest_residuals_and_a_slide_is_shown_once(results):
    s = results.solution.sightings
    found = wanted(results, "outlier")
    assert found
    assert all(m.residual_sigma > SETTINGS.outlier_sigmas for m in found)
    for camera in ("uav1", "uav2"):
        own = [m for m in found if m.camera == camera]
        assert len(own) <= SETTINGS.outliers
        assert [m.residual_sigma for m in own] == sorted((m.residual_sigma for m in own), reverse=True)
        rows = np.array([c == camera for c in s.camera])
        shown = [m for m in moments(results, {}, SETTINGS) if m.camera == camera]
        assert max(m.residual_sigma for m in shown) == pytest.approx(s.residual_sigma[rows].max())
        for i, one in enumerate(own):
            for other in own[:i]:
                assert one.target != other.target or abs(one.time_s - other.time_s) >= SETTINGS.apart_s


def test_the_solution_has_it_where_the_residual_says(results):
    for m in wanted(results, "outlier"):
        away = np.hypot(m.fix_px[0] - m.predicted_px[0], m.fix_px[1] - m.predicted_px[1])
        assert away == pytest.approx(m.residual_px)


def test_a_box_goes_with_the_frame_that_it_was_drawn_on(results):
    box = Box(frame=0, x=1, y=2, width=3, height=4)
    boxes = {("uav1", "van"): (box,), ("uav2", "van"): (dataclasses.replace(box, frame=7),)}
    drawn = [m for m in moments(results, boxes, SETTINGS) if m.box is not None]
    assert [(m.kind, m.camera, m.target, m.box) for m in drawn] == [("first", "uav1", "van", box)]


def test_what_took_no_part_in_the_solution_has_no_residual(results):
    none = dataclasses.replace(
        results.solution.sightings, camera=(), target=(), frame=np.zeros(0), time_s=np.zeros(0),
        residual_px=np.zeros((0, 2)), residual_sigma=np.zeros(0), weight=np.zeros(0), position_enu_m=np.zeros((0, 3)),
    )  # fmt: skip
    bare = dataclasses.replace(results, solution=dataclasses.replace(results.solution, sightings=none))
    assert all(np.isnan(m.residual_px) and np.isnan(m.predicted_px).all() for m in moments(bare, {}, SETTINGS))
