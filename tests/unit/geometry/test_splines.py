"""B-splines are SciPy's, in and beyond their knots, derivatives too."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from pipeline.geometry.splines import acting, interval_of, spline


def _knots(rng: np.random.Generator, degree: int, inner: int) -> np.ndarray:
    ends = np.sort(rng.uniform(-5, 30, 2))
    between = np.sort(rng.uniform(ends[0], ends[1], inner))
    return np.concatenate([np.repeat(ends[0], degree + 1), between, np.repeat(ends[1], degree + 1)])


@pytest.mark.parametrize("degree", range(6))
@pytest.mark.parametrize("inner", [0, 1, 7])
def test_values_and_derivatives_are_those_of_scipy(degree: int, inner: int) -> None:
    rng = np.random.default_rng(degree * 10 + inner)
    knots = _knots(rng, degree, inner)
    coefficients = rng.normal(size=(degree + 1 + inner, 3))
    at = np.concatenate([rng.uniform(knots[0] - 3, knots[-1] + 3, 50), knots])
    for derivative in range(degree + 2):
        mine = spline(knots, coefficients, degree, at, derivative)
        if derivative > degree:
            assert not mine.any()
        else:
            theirs = BSpline(knots, coefficients, degree)(at, nu=derivative)
            np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-12)


def test_acting_splines_sum_to_one_and_a_lost_time_stays_lost() -> None:
    knots = _knots(np.random.default_rng(1), 3, 5)
    at = np.array([knots[0], knots[5], knots[-1], np.nan])
    weight = acting(knots, 3, interval_of(knots, 3, at), at)
    np.testing.assert_allclose(weight[:3].sum(axis=1), 1.0)
    assert np.isnan(weight[3]).any()
