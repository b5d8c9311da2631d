"""Small functions on arrays that stand in for numpy's where these are slow to import."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.foundation.arrays import distinct, median


@pytest.mark.parametrize("many", [1, 2, 3, 4, 101, 1000])
def test_the_median_is_numpys_bit_for_bit(many):
    values = np.random.default_rng(many).normal(size=many)
    assert median(values) == float(np.median(values))
    values[many // 2] = np.nan
    assert np.isnan(median(values))


def test_the_median_of_nothing_is_none():
    assert np.isnan(median(np.empty(0)))


def test_distinct_values_are_numpys_without_nan():
    values = np.array([3.0, 1.0, np.nan, 3.0, -np.inf, 1.0, np.nan])
    assert distinct(values).tolist() == [-np.inf, 1.0, 3.0]
    assert distinct(np.array([2, 2, 1], np.uint8)).tolist() == [1, 2]
    assert distinct(np.empty(0)).tolist() == []
