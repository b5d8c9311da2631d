"""Gradients freed of their own leverage, against dense algebra and against really leaving sightings out."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.solver.adjustment.assembly import add_priors, assemble, blocks_at, linear, moved
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.seen_targets import seen_targets
from pipeline.solver.uncertainty import jackknife
from pipeline.solver.uncertainty.covariance import Inverse
from pipeline.solver.uncertainty.jackknife import freed_gradients
from tests.scenes.solver import changed, rich_model

KINDS = [("polynomial", "polynomial"), ("polynomial", "spline"), ("spline", "spline")]


def only(frames, chosen):
    """The frames, of which only the `chosen` see anything."""
    seen = frames.seen & chosen[:, None]
    return changed(frames, seen=seen, gain=np.where(seen[..., None, None], frames.gain, 0.0))


def data_alone(model, state, chosen):
    """Dense information and gradient of the chosen frames, without priors of what is shared."""
    part = changed(model, frames=only(model.frames, chosen))
    own = np.where(chosen[:, None], state.own, 0.0)
    seen = seen_targets(part, *blocks_at(part, changed(state, own=own)))
    system = assemble(part.order, seen, seen.normals(part))
    return system.times(np.eye(len(system.gradient))), system.gradient


def clustered(model, length):
    """Clusters of `length` frames of one camera."""
    frame = np.arange(model.frames.count) - model.frames.first[model.frames.camera]
    number = frame // length
    return model.frames.camera * (number.max() + 1) + number


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("length", [3, 17])
def test_against_dense_algebra(kinds, length):
    model, state = rich_model(kinds, "huber", pose_rate=False)
    cluster = clustered(model, length)
    system = linear(model, state).system
    found = freed_gradients(model, state, Inverse(factor=factorise(system)).block, cluster)
    inverse = np.linalg.inv(system.times(np.eye(len(system.gradient))))
    assert found.shape == (len(inverse), cluster.max() + 1)
    for c in (0, 1, int(cluster.max()) // 2, int(cluster.max())):
        information, gradient = data_alone(model, state, cluster == c)
        left = np.eye(len(inverse)) - jackknife.MOST_LEVERAGE * information @ inverse
        wanted = np.linalg.solve(left, gradient)
        np.testing.assert_allclose(inverse @ found[:, c], inverse @ wanted, atol=1e-6 * np.abs(inverse @ wanted).max())


def test_it_foretells_the_optimum_without_a_cluster(monkeypatch):
    """At an optimum of linear residuals' normal equations: one step without the cluster ends where it says."""
    monkeypatch.setattr(jackknife, "MOST_LEVERAGE", 1.0)
    model, state = rich_model(("polynomial", "spline"), pose_rate=False)
    cluster = clustered(model, 10)
    here = linear(model, state)
    factor = factorise(here.system)
    freed = freed_gradients(model, state, Inverse(factor=factor).block, cluster)
    chosen = 4
    rest = only(model.frames, cluster != chosen)
    part = changed(model, frames=rest)
    seen = seen_targets(part, *blocks_at(model, state))
    without, _ = add_priors(part, state, assemble(part.order, seen, seen.normals(part)))
    # the cluster's own gradient is what the optimum of all would lack
    _, gradient = data_alone(model, state, cluster == chosen)
    lacking = factorise(changed(without, gradient=gradient)).solve(gradient)
    np.testing.assert_allclose(factor.solve(freed[:, chosen]), lacking, atol=1e-6 * np.abs(lacking).max())
    assert np.isfinite(moved(model, here, lacking).coefficients).all()


@pytest.mark.parametrize("stretch", [(0, 1), (0, 30), (5, 9), (20, 41)])
def test_blocks_of_the_inverse(stretch):
    model, state = rich_model(("spline", "spline"), pose_rate=False)
    system = linear(model, state).system
    inverse = np.linalg.inv(system.times(np.eye(len(system.gradient))))
    n = system.n_band
    border = np.array([1, 4, 5])
    a, b = stretch[0], min(stretch[1], n)
    for low, high in ((a, b), (n - (b - a), n), (0, n)):
        rows = np.concatenate([np.arange(low, high), n + border])
        found = Inverse(factor=factorise(system)).block(low, high, border)
        wanted = inverse[np.ix_(rows, rows)]
        np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())
