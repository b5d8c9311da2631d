"""A find that does not go over the ground as the target went is not the target."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.tracking.target.track_state import FASTER, LEAST_TOLD_PX, SLOWER, Doubt

FOUND = np.array([100.0, 50.0])


def doubt(expected_px):
    return Doubt(otherwise=None, frames=3, anchor_px=FOUND, velocity=np.zeros(2), expected_px=np.array(expected_px))


@pytest.mark.parametrize(
    "way", [(0.0, 0.0), (0.9 * SLOWER * 20.0, 0.0), (0.0, 20.0), (-20.0, 0.0), (1.1 * FASTER * 20.0, 0.0)]
)
def test_what_stays_or_goes_elsewhere_is_another(way):
    assert doubt((20.0, 0.0)).goes_otherwise(FOUND + way)


@pytest.mark.parametrize("way", [(1.1 * SLOWER * 20.0, 0.0), (20.0, 15.0), (14.0, -14.0)])
def test_what_goes_as_it_went_is_not(way):
    assert not doubt((20.0, 0.0)).goes_otherwise(FOUND + way)


def test_too_short_a_way_tells_nothing():
    short = doubt((0.9 * LEAST_TOLD_PX, 0.0))
    assert not short.told
    assert not short.goes_otherwise(FOUND)
