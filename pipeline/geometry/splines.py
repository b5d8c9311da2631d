"""B-splines by de Boor's recursion: arrays in, arrays out.

Spline i of degree k lives on knots i to i + k + 1. In the knot interval s, [t_s, t_(s+1)), the k + 1 splines s - k to s
are not zero; the first and the last interval reach to infinity.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints


def interval_of(knots: Floats, degree: int, at: Floats) -> Ints:
    """The knot interval (...) that each place (...) is in, from `degree` on."""
    return np.clip(np.searchsorted(knots, at, side="right") - 1, degree, len(knots) - degree - 2)


def acting(knots: Floats, degree: int, interval: Ints, at: Floats, derivative: int = 0) -> Floats:
    """The degree + 1 B-splines (..., degree + 1) that are not zero in `interval` (...), or a derivative, `at` (...).

    Source: de Boor, A Practical Guide to Splines, chapter X.
    """
    value = np.ones((*at.shape, 1)) if derivative <= degree else np.zeros((*at.shape, degree + 1))
    for d in range(1, degree + 1) if derivative <= degree else ():
        grown = np.zeros((*at.shape, d + 1))
        for r in range(d):
            low, high = knots[interval - d + 1 + r], knots[interval + 1 + r]
            if d <= degree - derivative:
                share = value[..., r] / (high - low)
                grown[..., r] += (high - at) * share
                grown[..., r + 1] += (at - low) * share
            else:
                share = d * value[..., r] / (high - low)
                grown[..., r] -= share
                grown[..., r + 1] += share
        value = grown
    return value


def spline(knots: Floats, coefficients: Floats, degree: int, at: Floats, derivative: int = 0) -> Floats:
    """The spline with `coefficients` (p, m), or a derivative, (n, m) `at` (n,)."""
    interval = interval_of(knots, degree, at)
    weight = acting(knots, degree, interval, at, derivative)
    total = np.zeros((len(at), coefficients.shape[1]))
    for i in range(degree + 1):
        total += coefficients[interval - degree + i] * weight[:, i, None]
    return total
