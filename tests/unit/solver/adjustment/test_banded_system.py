"""The bordered banded system against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import cholesky_banded, solveh_banded

from pipeline.solver.adjustment import banded_system
from pipeline.solver.adjustment.banded_system import Bordered, band_of_inverse, band_of_inverse_plain, factorise
from pipeline.solver.uncertainty.covariance import Inverse


def made(n, q, width, seed=0):
    rng = np.random.default_rng(seed)
    size = n + q
    dense = np.zeros((size, size))
    for _ in range(4 * size):
        row = np.zeros(size)
        at = rng.integers(0, max(1, n - width)) if n else 0
        row[at : min(at + width + 1, n)] = rng.normal(size=min(at + width + 1, n) - at)
        row[n:] = rng.normal(size=q) * (rng.random(q) < 0.5)
        dense += np.outer(row, row)
    dense += np.eye(size)
    band = np.zeros((width + 1, n))
    for d in range(width + 1):
        band[d, : n - d] = np.diagonal(dense, -d)[: n - d]
    gradient = rng.normal(size=size)
    return Bordered(band=band, border=dense[:n, n:], corner=dense[n:, n:], gradient=gradient), dense


@pytest.mark.parametrize(("n", "q", "width"), [(40, 7, 5), (0, 9, 0), (30, 0, 4), (6, 2, 5)])
def test_against_dense(n, q, width):
    system, dense = made(n, q, width)
    factor = factorise(system)
    assert factor is not None
    right = np.random.default_rng(1).normal(size=(n + q, 3))
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(system.times(right), dense @ right, rtol=1e-10, atol=1e-10)
    assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(dense)[1])
    scale = np.linspace(0.5, 2.0, n + q)
    scaled = system.scaled(scale).damped(0.1 * np.ones(n + q))
    np.testing.assert_allclose(
        scaled.times(np.eye(n + q)), scale[:, None] * dense * scale + 0.1 * np.eye(n + q), atol=1e-9
    )


def test_covariances_of_pairs():
    system, dense = made(40, 6, 5)
    factor = factorise(system)
    wanted = np.linalg.inv(dense)
    covariance = Inverse(factor=factor, scale=2.0)
    i, j = np.meshgrid(np.arange(46), np.arange(46), indexing="ij")
    reachable = (np.abs(i - j) <= 5) | (i >= 40) | (j >= 40)
    found = covariance.pairs(i[reachable], j[reachable])
    np.testing.assert_allclose(found, 2 * wanted[reachable], rtol=1e-8, atol=1e-10)


def test_band_of_inverse_of_a_diagonal():
    np.testing.assert_allclose(band_of_inverse(np.array([[2.0, 4.0]])), [[0.25, 1 / 16]])


def test_not_positive_definite_is_none():
    system, _ = made(10, 2, 3)
    assert factorise(system.damped(-1e4 * np.ones(12))) is None


def test_band_of_inverse_by_the_compiled_twin():
    rng = np.random.default_rng(5)
    for width, n in ((0, 3), (3, 1), (3, 9), (11, 40)):
        lower = rng.normal(size=(width + 1, n))
        lower[0] = 3 + abs(lower[0])
        np.testing.assert_allclose(band_of_inverse(lower), band_of_inverse_plain(lower), rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize(("n", "q", "width"), [(50, 7, 8), (48, 3, 16), (9, 2, 8), (5, 4, 8)])
def test_wide_right_sides_by_blocks_against_scipy(monkeypatch, n, q, width):
    rng = np.random.default_rng(n)
    band = rng.normal(size=(width + 1, n))
    band[0] = 4 * width
    right = rng.normal(size=(n, q))
    wanted = solveh_banded(band, right, lower=True)
    monkeypatch.setattr(banded_system, "WIDE", 0)
    found = banded_system.solve_banded(cholesky_banded(band, lower=True), right)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-15)
