"""Compiled kernels against their plain numpy twins."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.records import SolverSettings
from pipeline.solver import how_compiled, make_ready, solve
from pipeline.solver.adjustment import _assembly, _kernels, compiled_descent, elimination
from pipeline.solver.adjustment.assembly import assemble, assemble_plain, blocks_at
from pipeline.solver.adjustment.elimination import (
    block_normals,
    block_normals_plain,
    frame_steps,
    frame_steps_plain,
    squared_lengths,
)
from pipeline.solver.adjustment.log_poses import carry, carry_plain
from pipeline.solver.adjustment.model import residuals_of
from pipeline.solver.adjustment.seen_targets import every_target
from pipeline.solver.observation.clocks import READOUT
from pipeline.solver.observation.observations import metric
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from tests.scenes.solver import changed, placed_model, rich_model

pytestmark = pytest.mark.skipif(not _kernels.AVAILABLE, reason="neither built ahead nor numba installed")
when_called = pytest.mark.skipif(how_compiled() != "when called", reason="built ahead: nothing is left to compile")


def alike(found, wanted):
    np.testing.assert_allclose(found, wanted, atol=1e-11 * max(1e-300, np.abs(wanted).max(initial=0)))


@pytest.mark.parametrize("pose_rate", [False, True])
@pytest.mark.parametrize(("kinds", "loss"), [
    (("polynomial",), "none"), (("polynomial", "polynomial"), "huber"), (("polynomial", "spline"), "cauchy"),
    (("spline", "spline"), "none"),
])  # fmt: skip
def test_twins(kinds, loss, pose_rate):
    model, state = rich_model(kinds, loss, pose_rate=pose_rate)
    for frames in (model.frames, metric(model.frames)):
        _both(changed(model, frames=frames), state)


def test_twins_where_cameras_stand_still():
    model, state = rich_model(("polynomial", "spline"))
    spread = model.pose.spread.copy()
    spread[0] = 0.0
    spread[1, :3] = 0.0
    held = np.where(spread[model.frames.camera] > 0, state.own, 0.0)
    _both(changed(model, pose=changed(model.pose, spread=spread)), changed(state, own=held))


def test_twins_without_prior_of_the_frames():
    model, state = rich_model(("polynomial", "polynomial"))
    prior = model.pose.prior.copy()
    prior[:, :3] = 0.0
    _both(changed(model, pose=changed(model.pose, prior=prior, damping=1e-3)), state)


@pytest.mark.parametrize("kinds", [("polynomial", "polynomial"), ("polynomial", "spline")])
def test_twins_with_place_errors(kinds):
    for loss in ("none", "huber"):
        model, state = placed_model(kinds, loss)
        for frames in (model.frames, metric(model.frames)):
            _both(changed(model, frames=frames), state)


@pytest.mark.parametrize("pose_rate", [False, True])
@pytest.mark.parametrize("kinds", [("polynomial",), ("polynomial", "spline")])
def test_twins_with_rolling_shutters(kinds, pose_rate):
    _both(*rich_model(kinds, "huber", pose_rate=pose_rate, rolled=True))


def test_twins_with_rolling_shutters_and_place_errors():
    model, state = placed_model(("polynomial", "polynomial"), "huber")
    free = model.priors.camera_free.copy()
    free[1, READOUT] = True
    by_readout = np.random.default_rng(0).normal(size=(*model.frames.seen.shape, 2))
    frames = changed(model.frames, by_readout=by_readout)
    _both(model.changed(frames=frames, priors=changed(model.priors, camera_free=free)), state)


def _both(model, state):
    blocks, at = blocks_at(model, state)
    given = (model.frames, model.pose, model.loss, at, blocks)
    fast, plain = block_normals(*given), block_normals_plain(*given)
    alike(fast.normal, plain.normal)
    alike(fast.gradient, plain.gradient)
    assert fast.cost == pytest.approx(plain.cost, rel=1e-12)
    assert fast.frame_gain == pytest.approx(plain.frame_gain, rel=1e-9, abs=1e-9)
    step = np.random.default_rng(0).normal(size=fast.gradient.shape)
    wanted = frame_steps_plain(*given, step)
    alike(frame_steps(*given, step), wanted)
    alike(frame_steps(*given, step, fast.kept), wanted)
    seen = every_target(model, blocks, at)
    quick, slow = assemble(model.order, seen, plain), assemble_plain(model.order, seen, plain)
    for part in ("band", "border", "corner", "gradient"):
        alike(getattr(quick, part), getattr(slow, part))
    square = (residuals_of(model.frames, slice(None), model, state) ** 2).sum(-1) * model.frames.seen
    alike(squared_lengths(model.frames, model.pose, at, blocks), square)


@pytest.mark.parametrize("populated", [True, False])
def test_twins_where_what_is_kept_is_large(monkeypatch, populated):
    """Memory of its own, fetched at once where the system can."""
    monkeypatch.setattr(elimination, "LARGE_PAGES", 0)
    if not populated:
        monkeypatch.setattr(elimination, "POPULATE_WRITE", -1)
    model, state = rich_model(("polynomial", "spline"))
    _both(model, state)


def test_what_would_take_too_much_is_not_kept():
    model, state = rich_model(("polynomial", "spline"))
    blocks, _ = blocks_at(model, state)
    assert len(elimination.kept_room(model.frames, blocks.begin, False, 1)) == 0
    assert len(elimination.kept_room(model.frames, blocks.begin, False, 10**9)) > 0


@when_called
def test_warming_up_loads_the_signatures_in_use():
    """A solve after `warm` must find everything compiled, or its seconds would count the compiler's."""
    compiled_descent.warm()
    used = (_kernels.block_normals, _kernels.kept_steps, _kernels.squared_lengths, _assembly.assemble)
    before = [len(k.signatures) for k in used]
    assert before == [1, 1, 1, 1]
    for pose_rate in (False, True):
        _both(*rich_model(("polynomial", "spline"), pose_rate=pose_rate))
    assert [len(k.signatures) for k in used] == before


def test_only_compiling_is_told():
    compiled_descent.warm()
    told = []
    make_ready(lambda done, of: told.append((done, of)))
    assert told == []


def test_poses_are_carried_alike():
    rng = np.random.default_rng(4)
    rate = rng.normal(size=(50, 6))
    seconds = np.concatenate([rng.normal(size=25) * 1e-3, rng.normal(size=25)])
    turn, position = np.tile(np.eye(3), (50, 1, 1)), rng.normal(size=(50, 3))
    fast, plain = (turn.copy(), position.copy()), (turn.copy(), position.copy())
    for _ in range(2):
        carry(rate, seconds, *fast)
        carry_plain(rate, seconds, *plain)
    for one, other in zip(fast, plain, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)


def test_a_whole_solve_without_numba(monkeypatch):
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_LOW, seed=0)
    fast = solve(problem, SolverSettings())
    monkeypatch.setattr(_kernels, "AVAILABLE", False)
    plain = solve(problem, SolverSettings())
    assert plain.cost == pytest.approx(fast.cost, rel=1e-9)
    np.testing.assert_allclose(plain.motions[0].coefficients, fast.motions[0].coefficients, atol=1e-6)
