"""Several boxes of a target bind its track: at each box it is the box, between two what both ways say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.records import Box
from pipeline.tracking import track_video
from pipeline.tracking.following.labels import Fixes, bound
from tests.scenes.video import BOX, panning, written

FIRST, SECOND = (Box(frame=f, x=40, y=40, width=20, height=20) for f in (0, 10))


def way(frames, x_px, label, sigma_px=0.1, box=False):
    n = len(frames)
    return Fixes(
        frame=np.array(frames, int), xy_px=np.column_stack([np.broadcast_to(x_px, n), np.zeros(n)]),
        sigma_px=np.full(n, sigma_px), linear=np.tile(np.eye(2), (n, 1, 1)), box=np.full(n, box),
        label=np.full(n, label),
    )  # fmt: skip


def test_between_two_boxes_each_way_counts_by_its_nearness():
    found = bound(way(range(10), 0.0, 0), way(range(1, 11), 4.0, 1), (FIRST, SECOND))
    np.testing.assert_array_equal(found.frame, np.arange(11))
    np.testing.assert_allclose(found.xy_px[:, 0], 0.4 * np.arange(11))
    assert found.sigma_px[0] == found.sigma_px[10] == pytest.approx(0.1)
    assert found.sigma_px[5] == pytest.approx(np.hypot(0.1, 4.0 / np.sqrt(8)))
    assert (np.diff(found.sigma_px[:6]) > 0).all()


def test_ways_that_contradict_each_other_give_no_fix():
    found = bound(way(range(10), 0.0, 0), way(range(1, 11), 11.0, 1), (FIRST, SECOND))
    np.testing.assert_array_equal(found.frame, [0, 10])


def test_where_one_way_lost_it_the_other_speaks():
    found = bound(way([0, 1, 2], 0.0, 0), way([6, 7, 8, 9, 10], 4.0, 1), (FIRST, SECOND))
    np.testing.assert_array_equal(found.frame, [0, 1, 2, 6, 7, 8, 9, 10])
    np.testing.assert_allclose(found.xy_px[:, 0], [0.0] * 3 + [4.0] * 5)
    assert not bound(way([0, 1], 0.0, 0), way([], 0.0, 0), (FIRST,)).label.any()


def test_a_point_of_the_surface_goes_before_the_middle_of_a_box():
    found = bound(way(range(10), 0.0, 0, 2.0, box=True), way(range(1, 11), 4.0, 1), (FIRST, SECOND))
    np.testing.assert_allclose(found.xy_px[1:10, 0], 4.0)
    np.testing.assert_allclose(found.sigma_px[1:10], 0.1)
    assert not found.box[1:].any()


def test_a_label_in_the_middle_takes_up_a_target_that_was_lost(tmp_path: Path) -> None:
    pictures = panning(60)
    for k in range(20, 30):  # hidden for good: it comes back elsewhere
        pictures[k][45:70] = pictures[0][90:115]
    for k in range(30, 60):
        pictures[k] = np.roll(pictures[k], 25, axis=0)
    path = written(tmp_path / "a.avi", pictures)
    again = Box(frame=40, x=30 + 60, y=75, width=24, height=16)
    once = track_video(path, camera="c", boxes={"t": BOX}).tracks[0]
    twice = track_video(path, camera="c", boxes={"t": [again, BOX]}).tracks[0]
    assert once.frame[0] == twice.frame[0] == 0
    assert twice.seen[:20].all()
    assert twice.seen[30:].all()
    assert not twice.seen[20:30].any()
    true_x = BOX.centre_px[0] + np.rint(1.5 * twice.frame)
    true_y = np.where(twice.frame < 30, BOX.centre_px[1], BOX.centre_px[1] + 25)
    off = np.hypot(twice.xy_px[:, 0] - true_x, twice.xy_px[:, 1] - true_y)[twice.seen]
    assert off.max() < 0.5
    np.testing.assert_allclose(twice.xy_px[40], again.centre_px, atol=1e-9)
    np.testing.assert_allclose(twice.xy_px[0], BOX.centre_px, atol=1e-9)
