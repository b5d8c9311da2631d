"""Gradient and normal matrix against central differences of the residuals, every unknown free at once."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.solver.adjustment.assembly import add_priors, assemble, blocks_at, linear, moved
from pipeline.solver.adjustment.seen_targets import seen_targets
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import metric
from pipeline.solver.observation.residuals import left_jacobian, linearise
from tests.scenes.solver import changed, rich_model, with_unknowns

STEP = 1e-6
KINDS = [("polynomial",), ("polynomial", "polynomial"), ("polynomial", "spline"), ("spline", "spline")]


def numerical_gradient(model, state):
    size = model.order.n_band + model.order.n_border
    out = np.zeros(size)
    still = np.zeros_like(state.own)
    for i in range(size):
        step = np.zeros(size)
        step[i] = STEP
        ahead, behind = (linear(model, with_unknowns(model, state, s * step, still)).cost for s in (1, -1))
        out[i] = (ahead - behind) / (2 * STEP)
    return out


@pytest.mark.parametrize("loss", ["none", "huber", "cauchy"])
@pytest.mark.parametrize("kinds", KINDS)
def test_gradient_of_shared_unknowns(kinds, loss):
    model, state = rich_model(kinds, loss, pose_rate=False)
    held = changed(model, pose=changed(model.pose, spread=np.zeros_like(model.pose.spread)))
    gradient = linear(held, state).system.gradient
    np.testing.assert_allclose(gradient, numerical_gradient(held, state), atol=1e-8 * np.abs(gradient).max())


def test_gradient_of_the_paper_s_residual():
    model, state = rich_model(("polynomial", "polynomial"), pose_rate=False, drift=False)
    held = changed(model, frames=metric(model.frames), pose=changed(model.pose, spread=0 * model.pose.spread))
    gradient = linear(held, state).system.gradient
    np.testing.assert_allclose(gradient, numerical_gradient(held, state), atol=1e-8 * np.abs(gradient).max())


def stacked_residuals(model, state):
    frames = model.frames
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    error = state.camera[frames.camera, :6] + model.pose.spread[frames.camera] * state.own
    position = model.basis.position(time, state.coefficients)
    found = linearise(frames, slice(None), position, error, state.camera[frames.camera, 6])
    return np.concatenate([found.residual.ravel(), state.own.ravel()])


def test_elimination_equals_the_dense_schur_complement():
    """The reduced system, the frames' steps and the foretold gain against one dense Jacobian of everything."""
    model, state = rich_model(("polynomial", "spline"), pose_rate=False)
    size, frames = model.order.n_band + model.order.n_border, model.frames.count
    columns = []
    for i in range(size + 6 * frames):
        step = np.zeros(size + 6 * frames)
        step[i] = STEP
        ahead, behind = (
            stacked_residuals(model, with_unknowns(model, state, s * step[:size], s * step[size:].reshape(frames, 6)))
            for s in (1, -1)
        )
        columns.append((ahead - behind) / (2 * STEP))
    J = np.array(columns).T
    H, g = J.T @ J, J.T @ stacked_residuals(model, state)
    A, B, D = H[:size, :size], H[:size, size:], H[size:, size:]
    reduced, right = A - B @ np.linalg.solve(D, B.T), g[:size] - B @ np.linalg.solve(D, g[size:])

    here = linear(model, state)
    system = assemble(model.order, here.seen, here.seen.normals(model))
    np.testing.assert_allclose(system.times(np.eye(size)), reduced, atol=1e-6 * np.abs(reduced).max())
    np.testing.assert_allclose(system.gradient, right, atol=1e-6 * np.abs(right).max())
    assert here.frame_gain == pytest.approx(0.5 * g[size:] @ np.linalg.solve(D, g[size:]), rel=1e-6)
    step = np.random.default_rng(0).normal(size=size) * 1e-3
    wanted = -np.linalg.solve(D, g[size:] + B.T @ step)
    found = (moved(model, here, step).own - state.own).ravel()
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


def test_priors_are_added_once():
    model, state = rich_model(("polynomial", "spline"))
    seen = seen_targets(model, *blocks_at(model, state))
    data = assemble(model.order, seen, seen.normals(model))
    whole, cost = add_priors(model, state, data)
    size = model.order.n_band + model.order.n_border
    added = whole.times(np.eye(size)) - data.times(np.eye(size))
    assert np.linalg.eigvalsh(added).min() > -1e-6 * np.abs(added).max()
    assert cost > 0


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.4, 3.0])
def test_left_jacobian_against_differences(angle):
    from pipeline.geometry import rotation

    w = angle * np.array([[0.6, -0.3, np.sqrt(1 - 0.45)]])
    J = left_jacobian(w)[0]
    for k in range(3):
        e = np.zeros((1, 3))
        e[0, k] = STEP
        ahead, behind = rotation.exp(w + e), rotation.exp(w - e)
        turned = rotation.log(rotation.multiply(ahead, rotation.conjugate(behind)))[0] / (2 * STEP)
        np.testing.assert_allclose(turned, J[:, k], atol=1e-7)
