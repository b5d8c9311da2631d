"""Rows on motions beside sightings: derivatives against differences, compiled descent against the plain one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import GroundHeights
from pipeline.solver.adjustment import _kernels
from pipeline.solver.adjustment.assembly import add_priors
from pipeline.solver.adjustment.banded_system import Bordered, factorise
from pipeline.solver.adjustment.known_rows import known_square
from pipeline.solver.adjustment.levenberg_marquardt import Descent, levenberg_marquardt, levenberg_marquardt_plain
from pipeline.solver.adjustment.model import jerk_penalty
from pipeline.solver.methods.intersection import intersect
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.known_motion import KnownMotion
from tests.scenes.solver import rich_model


def hilly(place_m):
    """A paraboloid: its slope is linear, so that central differences are exact."""
    east, north = np.asarray(place_m, float).T
    return GroundHeights(
        up_m=2 + 0.02 * east - 0.01 * north + 1e-4 * east**2, slope=np.stack([0.02 + 2e-4 * east, -0.01 + 0 * east], 1),
        rough_m=np.full(len(east), 0.2), known=np.ones(len(east), bool),
    )  # fmt: skip


def known_of(model):
    """Two targets on the ground that share one error and have one each; one of them also has a known place."""
    time = np.linspace(*model.basis.grid_s[[0, -1]], 6)
    return KnownMotion(
        target=np.array([0] * 6 + [1] * 6 + [1] * 3), time_s=np.concatenate([time, time, time[:3]]),
        sigma_m=np.linspace(0.3, 0.8, 15), axis=np.array([-1] * 12 + [0, 1, 2]),
        level_m=np.concatenate([np.full(12, 0.8), [3.0, -4.0, 5.0]]),
        around_m=np.tile([[[-2.0, 1.0], [0.0, 0.0], [3.0, 1.0]]], (15, 1, 1)), weight=np.array([0.25, 0.5, 0.25]),
        shared=np.array([[0, 1]] * 6 + [[0, 2]] * 6 + [[-1, -1]] * 3), share=np.tile([1.0, 0.6], (15, 1)),
        shared_sigma_m=np.array([1.0, 0.5, 0.7]),
        ground=hilly,
    )  # fmt: skip


def system_of(model, state):
    order = model.order
    n, q = order.n_band, order.n_border
    empty = Bordered(
        band=np.zeros((order.width + 1, n)), border=np.zeros((n, q)), corner=np.zeros((q, q)), gradient=np.zeros(n + q)
    )
    return add_priors(model, state, empty)


@pytest.mark.parametrize("kinds", [("polynomial", "spline"), ("polynomial", "polynomial")])
def test_the_gradient_is_that_of_the_cost_and_the_matrix_its_square(kinds):
    plain, state = rich_model(kinds=kinds, drift=False, pose_rate=False)
    # Without the jerk prior, which is another one for a target on the ground.
    plain = replace(plain, priors=replace(plain.priors, jerk=np.full_like(plain.priors.jerk, np.inf)))
    known = known_of(plain)
    model = plain.changed(known=known)
    state = replace(state, ground=np.array([0.3, -0.2, 0.1]))
    system, cost = system_of(model, state)
    without, cost_without = system_of(plain, state)
    assert cost - cost_without == pytest.approx(0.5 * known_square(model, state))
    n = model.order.n_band + model.order.n_border

    def moved(step):
        place = model.order.coefficient
        coefficients = state.coefficients + np.where(place >= 0, step[place], 0)
        return replace(state, coefficients=coefficients, ground=state.ground + step[model.order.ground])

    gradient = np.zeros(n)
    for k in np.unique([*model.order.coefficient.ravel(), *model.order.ground]):
        step = np.zeros(n)
        step[k] = 1e-4
        costs = [0.5 * known_square(model, moved(sign * step)) for sign in (1, -1)]
        gradient[k] = (costs[0] - costs[1]) / 2e-4
    own = system.gradient.copy()
    own[: len(without.gradient)] -= without.gradient
    np.testing.assert_allclose(own, gradient, rtol=1e-5, atol=1e-4 * np.abs(gradient).max())
    x = np.random.default_rng(1).normal(size=n)
    quadratic = x @ system.times(x) - x[: len(without.gradient)] @ without.times(x[: len(without.gradient)])
    flat = replace(known, ground=lambda p: replace(hilly(p), up_m=np.zeros(len(p))))
    assert flat.count == 3
    step = 1e-5 * x
    rise = known_square(model, moved(step)) - 2 * known_square(model, state) + known_square(model, moved(-step))
    assert quadratic == pytest.approx(rise / 2e-10, rel=0.02)  # Gauss-Newton: the paraboloid's own curvature is small


def test_the_ground_takes_the_place_of_the_jerk_prior_upwards():
    plain, _ = rich_model(kinds=("polynomial", "spline"), drift=False, pose_rate=False)
    spline = next(n for n, t in enumerate(plain.basis.targets) if t.kind == "spline")
    _, free, _ = jerk_penalty(plain, spline)
    _, held, _ = jerk_penalty(plain.changed(known=known_of(plain)), spline)
    np.testing.assert_allclose(held[..., :2], free[..., :2] * np.ones(2))
    assert np.all(np.abs(held[..., 2]) < 0.5 * np.abs(free[..., -1]))


@pytest.mark.skipif(not _kernels.AVAILABLE, reason="numba is not installed")
def test_the_compiled_descent_takes_the_same_path():
    model, state = rich_model(kinds=("polynomial", "polynomial"), drift=False, pose_rate=False)
    start = intersect(model, state)
    model, start = model.changed(known=known_of(model)), replace(start, ground=np.zeros(3))
    given = Descent(max_iterations=15)
    fast, plain = levenberg_marquardt(model, start, given), levenberg_marquardt_plain(model, start, given)
    assert (fast.status, fast.iterations) == (plain.status, plain.iterations)
    assert fast.cost == pytest.approx(plain.cost, rel=1e-9)
    for name in ("coefficients", "camera", "ground"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(plain.state, name), rtol=1e-6, atol=1e-6)
    wanted = plain.linear.system.corner
    np.testing.assert_allclose(fast.linear.system.corner, wanted, atol=1e-6 * np.abs(wanted).max())
    assert np.abs(fast.state.ground).max() > 0.01
    assert factorise(fast.linear.system) is not None


def test_a_target_is_drawn_to_its_known_place():
    model, state = rich_model(kinds=("polynomial", "polynomial"), drift=False, pose_rate=False)
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)[:1]
    known = KnownMotion(
        target=np.zeros(3, int), time_s=np.repeat(time, 3), sigma_m=np.full(3, 1e-6), axis=np.arange(3),
        level_m=np.array([7.0, 8.0, 9.0]),
        around_m=np.zeros((3, 1, 2)), weight=np.ones(1), shared=np.full((3, 2), -1),
        share=np.zeros((3, 2)), shared_sigma_m=np.zeros(0),
    )  # fmt: skip
    start = intersect(model, state)
    fit = levenberg_marquardt(model.changed(known=known), start, Descent(max_iterations=30))
    np.testing.assert_allclose(model.basis.position(time, fit.state.coefficients)[0, 0], [7, 8, 9], atol=1e-3)
