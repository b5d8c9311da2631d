"""What is worked out from the targets that each block sees is what all targets in every block give."""

import numpy as np
import pytest

from pipeline.solver.adjustment import assembly, seen_targets
from pipeline.solver.adjustment.assembly import blocks_at, linear, moved
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.judgement import common_steps
from pipeline.solver.methods.parameters import MotionChoice, basis_at
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import metric
from pipeline.solver.uncertainty.covariance import Inverse
from pipeline.solver.uncertainty.jackknife import freed_gradients
from pipeline.solver.uncertainty.redundancy import redundancy_table
from tests.scenes.solver import changed, placed_model, rich_model

KINDS = ("spline", "polynomial", "spline") * 3
"""Of nine targets, of different order."""


def in_turn(model, state):
    """The model with every target seen for its part of the flight only, at most two at once, and its state."""
    targets = len(model.basis.targets)
    number = model.frames.frame / (model.frames.frame.max() + 1) * targets
    away = number[:, None] - np.arange(targets)
    shown = model.frames.seen & (away > -0.3) & (away < 1.0)
    frames = changed(
        model.frames, seen=shown, gain=np.where(shown[..., None, None], model.frames.gain, 0.0),
        place_gain=np.where(shown, model.frames.place_gain, 0.0),
    )  # fmt: skip
    if len(frames.by_readout):
        frames = changed(frames, by_readout=frames.by_readout * shown[..., None])
    choice = MotionChoice(kinds=KINDS, orders=tuple(2 + n % 4 for n in range(targets)), spacing_s=0.2)
    basis = basis_at(frames, choice, common_time_s(frames, model.drift, state.camera, state.deviation))
    priors = changed(model.priors, jerk=np.full((targets, len(basis.grid_s) - 1), 2.0))
    model = model.changed(frames=frames, basis=basis, priors=priors)
    return model, changed(state, coefficients=np.random.default_rng(0).normal(size=(basis.count, 3)) * 20)


def scenes():
    yield "drift, pose rates, rolling shutters", in_turn(*rich_model(KINDS, "huber", rolled=True))
    yield "place errors", in_turn(*placed_model(KINDS, "cauchy"))
    model, state = in_turn(*rich_model(KINDS, drift=False, pose_rate=False))
    yield "metric", (changed(model, frames=metric(model.frames)), state)


@pytest.fixture(params=list(scenes()), ids=lambda scene: scene[0])
def scene(request):
    return request.param[1]


def with_all(call, monkeypatch):
    """What `call` gives where every block has every target."""
    with monkeypatch.context() as patch:
        patch.setattr(seen_targets, "MANY", 1000)
        return call()


def alike(found, wanted, share=1e-9):
    np.testing.assert_allclose(found, wanted, rtol=share, atol=share * max(1e-300, np.abs(wanted).max(initial=0)))


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("most", [4096, 5])
def test_the_adjustment_is_the_same(scene, monkeypatch, compiled, most):
    model, state = scene
    monkeypatch.setattr(assembly._kernels, "AVAILABLE", compiled and assembly._kernels.AVAILABLE)
    monkeypatch.setattr(assembly, "CHUNK_BLOCKS", most)
    few, all_of_them = linear(model, state), with_all(lambda: linear(model, state), monkeypatch)
    assert few.seen.target is not None
    assert few.seen.target.shape[1] <= 3
    assert all_of_them.seen.target is None
    size = model.order.n_band + model.order.n_border
    alike(few.system.times(np.eye(size)), all_of_them.system.times(np.eye(size)))
    alike(few.system.gradient, all_of_them.system.gradient)
    assert few.cost == pytest.approx(all_of_them.cost, rel=1e-12)
    assert few.frame_gain == pytest.approx(all_of_them.frame_gain, rel=1e-9)
    step = np.random.default_rng(1).normal(size=size) * 1e-3
    alike(moved(model, few, step).own, moved(model, all_of_them, step).own)


def test_gradients_of_clusters_are_the_same(scene, monkeypatch):
    model, state = scene
    block = Inverse(factor=factorise(linear(model, state).system)).block
    cluster = model.frames.camera * 100 + model.frames.frame // 7
    cluster = np.unique(cluster, return_inverse=True)[1]

    def found():
        return freed_gradients(model, state, block, cluster)

    alike(
        found(), with_all(found, monkeypatch), share=1e-5
    )  # what is freed of nearly all leverage is badly conditioned


def test_sums_from_the_end_are_the_same(scene, monkeypatch):
    model, state = scene
    monkeypatch.setattr(common_steps, "CHUNK_BLOCKS", 4)

    def found():
        seen = seen_targets.seen_targets(model, *blocks_at(model, state))
        rows = np.flatnonzero(seen.blocks.camera == 1)
        return common_steps._from_the_end(model, seen, rows, np.array([0, 3, len(rows) - 1]))

    for few, all_of_them in zip(found(), with_all(found, monkeypatch), strict=True):
        alike(few, all_of_them)


def test_leverages_ask_for_no_more_than_the_band_knows(scene):
    model, state = scene
    system = linear(model, state).system
    inverse = factorise(system).solve(np.eye(len(system.gradient)))
    square = np.ones(model.frames.seen.shape)

    class Dense:
        def pairs(self, i, j):
            return inverse[i, j]

    found, wanted = (
        redundancy_table(model, state, covariance, square)
        for covariance in (Inverse(factor=factorise(system)), Dense())
    )
    np.testing.assert_allclose(found.left, wanted.left, rtol=1e-5)
    np.testing.assert_allclose(found.own, wanted.own, rtol=1e-5, atol=1e-5)


def test_where_all_are_seen_nothing_is_moved():
    model, state = rich_model(KINDS)
    assert linear(model, state).seen.target is None
