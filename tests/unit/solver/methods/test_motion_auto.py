"""Motions that the data choose, poses whose errors last, targets that cannot be known: small flights, defaults only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import GeometryError
from pipeline.records import Problem, SolverSettings, TargetInput
from pipeline.solver import solve
from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.observation.pose_wander import wander_knots, wander_penalty
from pipeline.solver.observation.selection import without_targets
from pipeline.solver.observation.symmetric import solved
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from tests.scenes.solver import changed, rich_model


def asked(problem: Problem) -> Problem:
    return replace(problem, targets=tuple(TargetInput(target=t.target) for t in problem.targets))


@pytest.mark.parametrize("order", [1, 2])
def test_all_targets_are_judged_together_whatever_their_order(order):
    problem, _ = simulate(paper_scene(order=order, targets=2), noise=PAPER_LOW, seed=3)
    solution = solve(asked(problem), SolverSettings())
    turned = replace(asked(problem), targets=tuple(reversed(asked(problem).targets)))
    again = solve(turned, SolverSettings())
    assert [(m.kind, m.degree) for m in solution.motions] == [("polynomial", order)] * 2
    for name in ("target1", "target2"):
        one, other = solution.motion(name), again.motion(name)
        assert (one.kind, one.degree) == (other.kind, other.degree)
        time = np.linspace(one.start_s, one.end_s, 5)
        np.testing.assert_allclose(one.position_enu_m(time), other.position_enu_m(time), atol=1e-3)


def test_an_order_that_is_given_is_taken():
    assert not TargetInput(target="a", order=1).is_asked
    assert not TargetInput(target="a", motion="spline").is_asked
    assert TargetInput(target="a").is_asked
    assert TargetInput(target="a", motion="polynomial").is_asked


def test_wandering_errors_enter_the_normal_equations_as_they_enter_the_residuals():
    model, state = rich_model(drift=False)
    sigma = np.zeros((2, 6))
    sigma[1] = [0.01, 0.01, 0.01, 1.0, 1.0, 1.0]
    wander = wander_knots(model.frames, sigma, np.full((2, 6), 2.0))
    model = model.changed(wander=wander, pose=changed(model.pose, spread=np.zeros((2, 6))))
    rng = np.random.default_rng(0)
    state = changed(state, wander=rng.normal(size=(wander.count, 6)) * sigma[1])
    here = linear(model, state)
    for knot, axis in ((0, 4), (wander.count // 2, 1)):
        step = 1e-5 * sigma[1, axis]
        moved = []
        for sign in (1, -1):
            value = state.wander.copy()
            value[knot, axis] += sign * step
            moved.append(linear(model, changed(state, wander=value)).cost)
        slope = (moved[0] - moved[1]) / (2 * step)
        place = model.order.wander[knot, axis]
        np.testing.assert_allclose(here.system.gradient[place], slope, rtol=1e-3, atol=1e-3 * abs(slope) + 1e-6)


def test_the_process_has_the_sigma_and_the_memory_that_it_claims():
    model, _ = rich_model(drift=False)
    wander = wander_knots(model.frames, np.full((2, 6), 0.5), np.full((2, 6), 2.0))
    covariance = np.linalg.inv(wander_penalty(wander, 0, 0))
    knots = wander.knot_s[wander.of(0)]
    np.testing.assert_allclose(np.diag(covariance), 0.25, rtol=1e-9)
    np.testing.assert_allclose(covariance[0], 0.25 * np.exp(-(knots - knots[0]) / 2.0), rtol=1e-9)


def test_one_target_without_an_answer_is_left_out_and_the_others_are_solved():
    problem, _ = simulate(paper_scene(order=1, targets=3), noise=PAPER_LOW, seed=2)
    camera = problem.cameras[1]
    lonely = [camera.rays.targets.index("target3")]
    kept = ~np.isin(camera.rays.target, lonely)
    alone = replace(without_targets(problem, ["target3"]).cameras[1], rays=_only(camera.rays, kept))
    flight = replace(
        problem, cameras=(problem.cameras[0], alone),
        targets=(*problem.targets[:2], TargetInput(target="target3", motion="spline")),
    )  # fmt: skip
    solution = solve(flight, SolverSettings())
    assert [m.target for m in solution.motions] == ["target1", "target2"]
    (left,) = [f for f in solution.findings if f.kind == "target-left-out"]
    assert left.subject == "target3"
    assert "only uav1 sees it" in left.words


def _only(rays, kept):
    return replace(
        rays, target=rays.target[kept], frame=rays.frame[kept], time_s=rays.time_s[kept],
        direction_cam=rays.direction_cam[kept], pixel_from_ray=rays.pixel_from_ray[kept], sigma_px=rays.sigma_px[kept],
        focal_effect=None if rays.focal_effect is None else rays.focal_effect[kept],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"frame_rate": 1e-300}, "frame_rate"),
        ({"offset_s": 1e300}, "offset_s"),
    ],
)
def test_numbers_that_no_flight_has_are_refused_in_words(change, word):
    problem, _ = simulate(paper_scene(order=1, targets=1), noise=PAPER_LOW, seed=1)
    wrong = replace(problem, cameras=(problem.cameras[0], replace(problem.cameras[1], **change)))
    with pytest.raises(GeometryError, match=word):
        solve(wrong, SolverSettings())


def test_a_singular_system_has_its_shortest_answer():
    matrix = np.array([[2.0, 2.0], [2.0, 2.0]])
    np.testing.assert_allclose(solved(matrix, np.array([[4.0], [4.0]])), [[1.0], [1.0]], atol=1e-9)
    assert np.isnan(solved(np.full((2, 2), np.nan), np.ones((2, 1)))).all()
