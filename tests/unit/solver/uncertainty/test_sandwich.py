"""The cluster-robust covariance, in memory linear in time, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.solver.adjustment import assembly
from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.adjustment.banded_system import band_of_sandwich, factorise
from pipeline.solver.adjustment.model import drift_penalty, jerk_penalty
from pipeline.solver.uncertainty import jackknife
from pipeline.solver.uncertainty.covariance import Inverse, motion_band, sandwich
from pipeline.solver.uncertainty.jackknife import freed_gradients
from tests.scenes.solver import rich_model


def banded(rng, width, n):
    """A positive definite band (width + 1, n) and the matrix."""
    lower = np.tril(np.triu(rng.normal(size=(n, n)), -width)) + 3 * np.eye(n)
    whole = np.tril(np.triu(lower @ lower.T, -width), width) + 20 * np.eye(n)
    return np.stack([np.append(np.diagonal(whole, -d), np.zeros(d)) for d in range(width + 1)]), whole


@pytest.mark.parametrize(("width", "meat_width", "n"), [(3, 2, 30), (3, 7, 30), (0, 0, 5), (4, 4, 3)])
def test_the_band_of_a_sandwich(width, meat_width, n):
    rng = np.random.default_rng(1)
    (band, matrix), (meat_band, meat) = banded(rng, min(width, n - 1), n), banded(rng, min(meat_width, n - 1), n)
    wanted = np.linalg.inv(matrix) @ meat @ np.linalg.inv(matrix)
    found = band_of_sandwich(band, meat_band)
    for d in range(len(found)):
        np.testing.assert_allclose(found[d, : n - d], np.diagonal(wanted, -d), rtol=1e-9, atol=1e-12)


def priors_of(model, size):
    """Their dense information, on its own."""
    out = np.zeros((size, size))
    known = (model.order.camera >= 0) & (model.priors.camera_precision > 0)
    at = model.order.camera[known]
    out[at, at] = model.priors.camera_precision[known]
    for c in range(len(model.frames.cameras)):
        own = model.drift.of(c)
        if own.stop > own.start:
            place = model.order.drift[own]
            out[np.ix_(place, place)] += drift_penalty(model.drift, c, float(model.priors.drift_rate[c]))
    for n, target in enumerate(model.basis.targets):
        if target.kind == "spline":
            for begin, row in zip(*jerk_penalty(model, n)[:2], strict=True):
                for axis in range(3):
                    place = model.order.coefficient[begin : begin + len(row), axis]
                    out[np.ix_(place, place)] += np.outer(row[:, axis], row[:, axis])
    return out


@pytest.mark.parametrize("kinds", [("polynomial", "polynomial"), ("polynomial", "spline"), ("spline", "spline")])
@pytest.mark.parametrize(("length", "chunk"), [(1, 4096), (17, 4096), (3, 5)])
def test_against_dense_algebra(monkeypatch, kinds, length, chunk):
    for module in (assembly, jackknife):
        monkeypatch.setattr(module, "CHUNK_BLOCKS", chunk)
    model, state = rich_model(kinds, "huber", pose_rate=False)
    frame = np.arange(model.frames.count) - model.frames.first[model.frames.camera]
    number = frame // length
    cluster = model.frames.camera * (number.max() + 1) + number
    system = linear(model, state).system
    plain = Inverse(factor=factorise(system))
    found = sandwich(model, state, plain, system, cluster)
    size = len(system.gradient)
    inverse = np.linalg.inv(system.times(np.eye(size)))
    gradients = freed_gradients(model, state, plain.block, cluster)
    wanted = inverse @ (gradients @ gradients.T + priors_of(model, size)) @ inverse
    sigma = np.sqrt(np.diagonal(wanted))
    border = np.arange(system.n_band, size)
    every = np.arange(size)
    pairs = [(border[:, None], border), (every[:, None], border), (every, every)]
    for i, j in pairs:
        np.testing.assert_allclose(
            found.pairs(i, j) / (sigma[i] * sigma[j]), wanted[i, j] / (sigma[i] * sigma[j]), atol=1e-7
        )
    for n, t in enumerate(model.basis.targets):
        band = motion_band(found, model, n)
        place = model.order.coefficient[t.first : t.first + t.count]
        for d in range(band.shape[1]):
            a = np.arange(t.count - d)
            block = wanted[place[a][:, :, None], place[a + d][:, None, :]]
            scale = sigma[place[a]][:, :, None] * sigma[place[a + d]][:, None, :]
            np.testing.assert_allclose(band[a, d] / scale, block / scale, atol=1e-7)


def test_systems_in_pieces_are_the_whole(monkeypatch):
    model, state = rich_model(("polynomial", "spline"), "huber")
    whole = linear(model, state)
    monkeypatch.setattr(assembly, "CHUNK_BLOCKS", 3)
    pieces = linear(model, state)
    assert pieces.kept is None
    assert pieces.cost == pytest.approx(whole.cost, rel=1e-12)
    assert pieces.frame_gain == pytest.approx(whole.frame_gain, rel=1e-12)
    for part in ("band", "border", "corner", "gradient"):
        wanted = getattr(whole.system, part)
        np.testing.assert_allclose(getattr(pieces.system, part), wanted, atol=1e-12 * np.abs(wanted).max())
