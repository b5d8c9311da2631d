"""A find that goes along with the ground, where the target would have gone over it, is not the target."""

from __future__ import annotations

import numpy as np

from pipeline.tracking.target.track_state import LEAST_TOLD_PX, SLOWER, Doubt


def doubt(expected_px):
    return Doubt(otherwise=None, frames=3, anchor_px=np.array([100.0, 50.0]), speed=10.0, expected_px=expected_px)


def test_what_stays_where_the_ground_is_stands_still():
    assert doubt(20.0).stands_still(np.array([100.0, 50.0]))
    assert doubt(20.0).stands_still(np.array([100.0 + 0.9 * SLOWER * 20.0, 50.0]))


def test_what_moves_over_the_ground_does_not():
    assert not doubt(20.0).stands_still(np.array([100.0 + 1.1 * SLOWER * 20.0, 50.0]))
    assert not doubt(20.0).stands_still(np.array([100.0, 70.0]))


def test_too_short_a_way_tells_nothing():
    assert not doubt(0.9 * LEAST_TOLD_PX).stands_still(np.array([100.0, 50.0]))
