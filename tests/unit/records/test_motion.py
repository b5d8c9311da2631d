"""Motions against SciPy and against plain powers of time."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from pipeline.records import Motion


def spline(rng, degree=3, inner=9):
    knots = np.arange(-degree, inner + degree + 1.0)
    p = len(knots) - degree - 1
    root = rng.normal(size=(3 * p, 3 * p))
    return knots, p, root @ root.T


def test_position_covariance_is_the_full_propagation():
    rng = np.random.default_rng(3)
    k = 3
    knots, p, full = spline(rng, k)
    band = np.zeros((p, k + 1, 3, 3))
    for i in range(p):
        for j in range(min(k + 1, p - i)):
            band[i, j] = full[3 * i : 3 * i + 3, 3 * (i + j) : 3 * (i + j) + 3]
    motion = Motion(
        target="a", kind="spline", degree=k, knots_s=knots, coefficients=rng.normal(size=(p, 3)),
        covariance_band=band, start_s=0, end_s=9,
    )  # fmt: skip
    time = np.array([0.0, 0.4, 3.0, 8.99, 9.0])
    design = BSpline.design_matrix(time, knots, k).toarray()
    for row, found in zip(design, motion.position_covariance(time), strict=True):
        jacobian = np.kron(row, np.eye(3))
        np.testing.assert_allclose(found, jacobian @ full @ jacobian.T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("order", range(6))
def test_a_polynomial_is_its_power_coefficients(order):
    rng = np.random.default_rng(order)
    a, b = 12.0, 31.0
    motion = Motion(
        target="a", kind="polynomial", degree=order, knots_s=np.repeat([a, b], order + 1),
        coefficients=rng.normal(size=(order + 1, 3)), start_s=a, end_s=b,
    )  # fmt: skip
    powers = motion.power_coefficients(epoch_s=20.0)
    time = np.linspace(a - 5, b + 5, 11)
    np.testing.assert_allclose(
        sum(powers[k] * (time[:, None] - 20.0) ** k for k in range(order + 1)), motion.position_enu_m(time), atol=1e-8
    )


def test_records_do_not_change():
    motion = Motion(
        target="a", kind="polynomial", degree=0, knots_s=[0, 1], coefficients=[[1, 2, 3]], start_s=0, end_s=1
    )
    with pytest.raises(ValueError, match="read-only"):
        motion.coefficients[0, 0] = 5
    with pytest.raises(AttributeError):
        motion.degree = 2
