"""The band is as wide as targets live side by side, not as the flight is long; nothing is lost of what reaches over."""

import numpy as np
import pytest

from pipeline.solver.adjustment import assembly, elimination
from pipeline.solver.adjustment.assembly import blocks_at, linear
from pipeline.solver.adjustment.elimination import block_normals
from pipeline.solver.adjustment.seen_targets import every_target, global_places
from pipeline.solver.judgement import common_steps
from pipeline.solver.methods.parameters import MotionChoice, basis_at
from pipeline.solver.observation.clocks import OFFSET, common_time_s
from tests.scenes.solver import changed, rich_model


def one_after_the_other(targets=4):
    """A model in which every target is seen for a part of the flight, and its state."""
    kinds = ("spline",) * targets
    model, state = rich_model(kinds, drift=False)
    frames, number = model.frames, model.frames.frame / (model.frames.frame.max() + 1)
    alive = np.floor(number * targets)[:, None] == np.arange(targets)
    seen = frames.seen & alive
    frames = changed(frames, seen=seen, gain=np.where(seen[..., None, None], frames.gain, 0.0))
    choice = MotionChoice(kinds=kinds, orders=(3,) * targets, spacing_s=0.2)
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    basis = basis_at(frames, choice, time)
    priors = changed(model.priors, jerk=np.full((targets, len(basis.grid_s) - 1), 2.0))
    model = model.changed(frames=frames, basis=basis, priors=priors)
    coefficients = np.random.default_rng(0).normal(size=(model.basis.count, 3)) * 20
    return model, changed(state, coefficients=coefficients)


def whole(model, state):
    """The normal equations of the data as a full matrix, every target acting in every block."""
    blocks, at = blocks_at(model, state)
    normals = block_normals(model.frames, model.pose, model.loss, at, blocks)
    chain, size = every_target(model, blocks, at).chain(), model.order.n_band + model.order.n_border
    everything = changed(model.frames, seen=np.ones_like(model.frames.seen))
    places = global_places(changed(model, frames=everything), blocks)
    out = np.zeros((size + 1, size + 1))
    for k, place in enumerate(places):
        np.add.at(out, (place[:, None], place), chain[k].T @ normals.normal[k] @ chain[k])
    return out[:size, :size]


@pytest.mark.parametrize("moved_s", [0.0, 1.1])
def test_a_band_of_targets_that_follow_each_other_is_narrow_and_whole(monkeypatch, moved_s):
    model, state = one_after_the_other()
    camera = state.camera.copy()
    camera[1, OFFSET] += moved_s  # what the second camera sees comes to lie beyond the knots
    state = changed(state, camera=camera)
    assert model.order.width < model.order.n_band / 3
    wanted = whole(model, state)
    for compiled in (True, False):
        monkeypatch.setattr(assembly._kernels, "AVAILABLE", compiled and assembly._kernels.AVAILABLE)
        system, _ = linear(model, state).data
        np.testing.assert_allclose(system.times(np.eye(len(wanted))), wanted, atol=1e-9 * np.abs(wanted).max())
        assert (len(system.band) - 1 > model.order.width) == (moved_s > 0)


def test_parts_of_different_width_add_up():
    model, state = one_after_the_other()
    camera = state.camera.copy()
    camera[1, OFFSET] += 1.1
    state = changed(state, camera=camera)
    at_once, _ = linear(model, state).data
    for most in (1, 7):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(assembly, "CHUNK_BLOCKS", most)
            in_parts, _ = linear(model, state).data
        assert in_parts.band.shape == at_once.band.shape
        for part in ("band", "border", "corner", "gradient"):
            wanted = getattr(at_once, part)
            np.testing.assert_allclose(getattr(in_parts, part), wanted, atol=1e-12 * np.abs(wanted).max())


def test_matrices_of_many_targets_are_held_in_bounded_memory(monkeypatch):
    model, state = one_after_the_other()
    blocks, at = blocks_at(model, state)
    seen = every_target(model, blocks, at)
    size = 4 * 3 * 4 + blocks.local_from_camera.shape[1]
    monkeypatch.setattr(elimination, "CHUNK_BYTES", 8 * size * size * 5)
    assert seen.at_once(1000) == 5
    assert seen.at_once(3) == 3
    monkeypatch.setattr(elimination, "CHUNK_BYTES", 1)
    assert seen.at_once(3) == 1


def test_sums_from_the_end_are_those_of_all_blocks(monkeypatch):
    model, state = one_after_the_other()
    blocks, at = blocks_at(model, state)
    rows = np.flatnonzero(blocks.camera == 1)
    places = np.array([0, 3, len(rows) - 1])
    monkeypatch.setattr(common_steps, "CHUNK_BLOCKS", 4)
    gradient, normal, coupling = common_steps._from_the_end(model, every_target(model, blocks, at), rows, places)
    normals = block_normals(model.frames, model.pose, model.loss, at, blocks)
    pose = slice(3 * 4 * 4, 3 * 4 * 4 + 6)
    chain = every_target(model, blocks, at).chain()
    where = global_places(model, blocks)
    for k, place in enumerate(places):
        after = rows[place:]
        np.testing.assert_allclose(gradient[k], normals.gradient[after, pose].sum(axis=0), rtol=1e-9)
        np.testing.assert_allclose(normal[k], normals.normal[after, pose, pose].sum(axis=0), rtol=1e-9)
        wanted = np.zeros((6, coupling.shape[2] + 1))
        for b in after:
            wanted[:, where[b]] += normals.normal[b, pose] @ chain[b]
        np.testing.assert_allclose(coupling[k], wanted[:, :-1], atol=1e-9 * np.abs(coupling).max())
