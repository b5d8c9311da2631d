"""Compiled steps against the plain ones: the same path, the same end, the same linear system there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import GeometryError
from pipeline.records import SolverSettings
from pipeline.solver import how_compiled
from pipeline.solver.adjustment import _descent, _kernels, compiled_descent
from pipeline.solver.adjustment import levenberg_marquardt as levenberg_marquardt_module
from pipeline.solver.adjustment.levenberg_marquardt import Descent, levenberg_marquardt, levenberg_marquardt_plain
from pipeline.solver.adjustment.log_poses import carry_plain
from pipeline.solver.methods import initialisation, intersection
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model
from pipeline.solver.observation.observations import metric, pack
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

pytestmark = pytest.mark.skipif(not _kernels.AVAILABLE, reason="neither built ahead nor numba installed")
METHODS = ["map", "algorithm-1", "algorithm-2"]


def begun(method, robust="none", place_px=(0.0, 0.0), lensed=False):
    problem, _ = simulate(paper_scene(order=2, targets=2), noise=PAPER_LOW, seed=3)
    cameras = [replace(c, rays=replace(c.rays, place_sigma_px=place_px)) for c in problem.cameras]
    if lensed:
        cameras = [
            replace(
                c,
                rays=replace(c.rays, focal_effect=np.tile([1.3, 0.5], (len(c.rays.frame), 1))),
                sigma=replace(c.sigma, focal=0.01),
            )
            for c in cameras
        ]
    problem = replace(problem, cameras=tuple(cameras))
    settings = SolverSettings(method=method, robust=robust)
    frames = pack(problem) if method == "map" else metric(pack(problem))
    model, state = first_model(problem, settings, frames, first_choice(problem), first_camera(problem, {}, {}))
    return model, state


@pytest.mark.parametrize(("method", "robust", "place_px", "lensed"), [
    *((m, "none", (0.0, 0.0), False) for m in METHODS), ("map", "huber", (0.0, 0.0), False),
    ("map", "cauchy", (0.0, 0.0), False), ("map", "huber", (2.0, 1.0), False), ("map", "huber", (0.0, 0.0), True),
])  # fmt: skip
def test_the_same_path(method, robust, place_px, lensed):
    model, state = begun(method, robust, place_px, lensed)
    start = intersection.intersect(model, state)
    assert compiled_descent.is_dense(model)
    costs: list[float] = []
    given = Descent(max_iterations=12, progress=lambda _, cost: costs.append(cost))
    fast = levenberg_marquardt(model, start, given)
    plain = levenberg_marquardt_plain(model, start, replace(given, progress=None))
    assert (fast.status, fast.iterations) == (plain.status, plain.iterations)
    assert fast.cost == pytest.approx(plain.cost, rel=1e-9)
    assert costs[-1] == pytest.approx(fast.cost, rel=1e-9)
    for name in ("coefficients", "camera", "own"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(plain.state, name), rtol=1e-6, atol=1e-6)
    wanted = plain.linear.system
    np.testing.assert_allclose(fast.linear.system.corner, wanted.corner, atol=1e-6 * np.abs(wanted.corner).max())


@pytest.mark.parametrize(("place_px", "lensed"), [((0.0, 0.0), False), ((2.0, 1.0), False), ((0.0, 0.0), True)])
def test_the_same_stages_of_a_graduated_loss(monkeypatch, place_px, lensed):
    model, state = begun("map", "huber", place_px, lensed)
    start = intersection.intersect(model, state)
    fast = initialisation.graduated(model, start, Descent(max_iterations=20))
    for module in (compiled_descent, levenberg_marquardt_module):
        monkeypatch.setattr(module, "is_dense", lambda _: False)
    plain = initialisation.graduated(model, start, Descent(max_iterations=20))
    assert fast.iterations == plain.iterations > 3
    assert fast.cost == pytest.approx(plain.cost, rel=1e-9)
    np.testing.assert_allclose(fast.state.camera, plain.state.camera, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("lensed", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_the_first_motion_is_the_same(monkeypatch, turned, lensed):
    model, state = begun("map", lensed=lensed)
    seen = np.random.default_rng(5).random(model.frames.seen.shape) < 0.7
    model = replace(model, frames=replace(model.frames, seen=seen, gain=model.frames.gain * seen[..., None, None]))
    if turned:  # constant rotation, position and focal length of every camera, and clocks
        camera = state.camera.copy()
        camera[:, :9] += [0.02, -0.01, 0.03, 0.5, -0.3, 0.2, 0.01, 0.05, 1e-3]
        state = replace(state, camera=camera)
    for start in (intersection.intersect, intersection.intersect_weighted):
        fast = start(model, state)
        with monkeypatch.context() as patched:
            patched.setattr(intersection, "is_dense", lambda _: False)
            plain = start(model, state)
        np.testing.assert_allclose(fast.coefficients, plain.coefficients, rtol=1e-8)


@pytest.mark.parametrize("compiled", [True, False])
def test_an_undetermined_motion_is_refused_either_way(monkeypatch, compiled):
    model, state = begun("map")
    seen = model.frames.seen.copy()
    seen[:, 1] = False
    blind = replace(model, frames=replace(model.frames, seen=seen, gain=model.frames.gain * seen[..., None, None]))
    if not compiled:
        monkeypatch.setattr(intersection, "is_dense", lambda _: False)
    with pytest.raises(GeometryError, match="touch no sight ray"):
        intersection.intersect(blind, state)


@pytest.mark.skipif(how_compiled() != "when called", reason="built ahead: nothing is left to compile")
def test_warming_up_compiles_what_a_descent_uses():
    compiled_descent.warm()
    used = (
        _descent.localise, _descent.folded, _descent.damped_step, _descent.tried, _descent.motion_alone,
        _descent.motion_columns, _kernels.block_normals, _kernels.kept_steps, _kernels.squared_lengths,
    )  # fmt: skip
    for place_px, lensed in (((0.0, 0.0), False), ((2.0, 1.0), True)):
        model, state = begun("map", "huber", place_px, lensed)
        initialisation.graduated(model, intersection.intersect(model, state), Descent(max_iterations=5))
    assert [len(k.signatures) for k in used] == [1] * len(used)


@pytest.mark.parametrize("wobbly", [False, True])
def test_poses_that_move_with_the_clocks_take_the_same_path(wobbly):
    """What a log's poses need: they are renewed at every point, and their rates are derivatives."""
    model, state = begun("map")
    start = intersection.intersect(model, state)
    rate = np.random.default_rng(1).normal(size=(model.frames.count, 6)) * [0.05, 0.05, 0.05, 5, 5, 5]
    model = replace(model, frames=replace(model.frames, pose_rate=rate))

    def renew(model, state):
        if not wobbly:
            return model
        turn, position = model.frames.cam_from_enu.copy(), model.frames.position_m.copy()
        now = model.frames.video_s * state.camera[model.frames.camera, 8]
        carry_plain(rate, now - model.frames.pose_shift_s, turn, position)
        return replace(model, frames=replace(model.frames, cam_from_enu=turn, position_m=position, pose_shift_s=now))

    given = Descent(max_iterations=12, renew=renew)
    fast = levenberg_marquardt(model, start, given)
    plain = levenberg_marquardt_plain(model, start, given)
    assert (fast.status, fast.iterations) == (plain.status, plain.iterations)
    assert fast.cost == pytest.approx(plain.cost, rel=1e-9)
    for name in ("coefficients", "camera", "own"):
        np.testing.assert_allclose(getattr(fast.state, name), getattr(plain.state, name), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(fast.model.frames.position_m, plain.model.frames.position_m, rtol=1e-6)
