"""Every method on a simulated flight, with and without noise, and what its Solution says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import GeometryError
from pipeline.geometry import rotation
from pipeline.records import SolverSettings, TargetInput
from pipeline.records.problem import METHODS
from pipeline.solver import solve
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_HIGH, PAPER_LOW, Noise, simulate

TINY = Noise(pixel_px=0.01, frame_rate_prior=0.1)
EXACT = {"li", "algorithm-1", "algorithm-2", "map"}


def error_m(solution, truth):
    worst = []
    for true in truth.trajectories:
        motion = solution.motion(true.target)
        inside = (true.time_s >= motion.start_s) & (true.time_s <= motion.end_s)
        found = motion.position_enu_m(true.time_s[inside])
        worst.append(np.linalg.norm(found - true.position_enu_m[inside], axis=1).mean())
    return float(np.mean(worst))


@pytest.mark.parametrize("method", METHODS)
def test_perfect_rays_give_the_truth(method):
    """Synchronous cameras for those that need them; a second of unknown offset for the others."""
    late = 3.0 if method in EXACT else 0.0
    problem, truth = simulate(paper_scene(order=2, targets=4, offset_frames=late), noise=TINY, seed=3)
    solution = solve(problem, SolverSettings(method=method))
    assert solution.status == "converged"
    assert error_m(solution, truth) < 0.05
    assert solution.clock("uav2").offset_s == pytest.approx(late / 10, abs=0.01)
    assert solution.method == method
    assert len(solution.sightings.frame) == 400


@pytest.mark.parametrize("method", ["algorithm-1", "map"])
def test_a_wrong_frame_rate_is_found(method):
    problem, truth = simulate(paper_scene(order=2, targets=4, offset_frames=2, given_rate_hz=9.0), noise=TINY, seed=3)
    solution = solve(problem, SolverSettings(method=method))
    assert solution.clock("uav2").frame_rate == pytest.approx(10.0, abs=0.01)
    assert solution.clock("uav2").nominal_rate == 9.0
    assert error_m(solution, truth) < 0.1
    held = solve(problem, SolverSettings(method=method, refine_frame_rate=False))
    assert held.clock("uav2").frame_rate == 9.0
    assert held.clock("uav2").frame_rate_sigma == 0.0


def test_methods_in_the_order_of_the_paper():
    errors = {m: [] for m in ("intersection", "li", "algorithm-1", "map")}
    for seed in range(6):
        problem, truth = simulate(paper_scene(order=1, targets=4, offset_frames=8), noise=PAPER_LOW, seed=seed)
        for method, found in errors.items():
            found.append(error_m(solve(problem, SolverSettings(method=method)), truth))
    mean = {m: np.mean(e) for m, e in errors.items()}
    assert mean["intersection"] > mean["li"] > mean["map"]
    assert mean["intersection"] > mean["algorithm-1"] > mean["map"]


def test_the_solution_is_whole():
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    solution = solve(problem, SolverSettings())
    n = len(solution.shared_names)
    assert n == 14  # six biases of each camera, offset and frame rate of the second
    assert "uav2.offset_s" in solution.shared_names
    for matrix in (solution.shared_covariance, solution.shared_covariance_robust):
        assert matrix.shape == (n, n)
        assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()
    place = solution.shared_names.index("uav2.offset_s")
    larger = np.maximum(np.diag(solution.shared_covariance), np.diag(solution.shared_covariance_robust))
    assert np.sqrt(larger[place]) == pytest.approx(solution.clock("uav2").offset_sigma_s)
    place = solution.shared_names.index("uav2.frame_rate")
    assert np.sqrt(larger[place]) == pytest.approx(solution.clock("uav2").frame_rate_sigma)
    assert solution.clock("uav1").offset_sigma_s == 0.0
    assert len(solution.motions_robust) == 2
    assert solution.chi_square == pytest.approx(2 * solution.cost, rel=0.2)
    assert 0.7 < solution.chi_square / solution.degrees_of_freedom < 1.3
    assert solution.seconds > 0
    assert [p.camera for p in solution.poses] == ["uav1", "uav2"]


def test_every_prior_of_a_free_unknown_is_an_observation():
    """400 equations and 13 priors (offset unknown) less 14 camera unknowns and 2 x 6 of the motion."""
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    solution = solve(problem, SolverSettings())
    equations, names = 2 * len(solution.sightings.frame), solution.shared_names
    without_prior = sum(c.sigma.offset_s is None or c.offset_s is None for c in problem.cameras[1:])
    assert equations == 400
    assert solution.degrees_of_freedom == equations + len(names) - without_prior - len(names) - 12


def test_the_same_problem_gives_the_same_bits():
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    one, two = (solve(problem, SolverSettings()) for _ in range(2))
    assert np.array_equal(one.motions[0].coefficients, two.motions[0].coefficients)
    assert one.cost == two.cost


def test_refined_poses_reproject_the_sightings():
    """Residuals of the record follow from its own poses and motions."""
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    solution = solve(problem, SolverSettings())
    rays, poses = problem.cameras[1].rays, solution.poses[1]
    frame = np.searchsorted(poses.frame, rays.frame)
    own = np.array(solution.sightings.camera) == "uav2"
    away = solution.sightings.position_enu_m[own] - poses.position_enu_m[frame]
    y = rotation.rotate(rotation.conjugate(poses.enu_from_cam[frame]), away)
    depth = (rays.direction_cam * y).sum(axis=1)
    predicted = (rays.pixel_from_ray @ y[..., None])[..., 0] / depth[:, None]
    np.testing.assert_allclose(solution.sightings.residual_px[own], -predicted, atol=1e-9)


def test_the_data_choose_the_order():
    for order in (0, 1, 2, 3):
        scene = paper_scene(order=max(order, 1), targets=2, offset_frames=3)
        problem, _ = simulate(scene, noise=replace(TINY, pixel_px=0.5), seed=1)
        if order == 0:
            continue
        auto = tuple(TargetInput(target=t.target, motion="polynomial", order="auto") for t in problem.targets)
        solution = solve(replace(problem, targets=auto), SolverSettings())
        assert [m.degree for m in solution.motions] == [order, order]
        reasons = [f for f in solution.findings if f.kind == "motion-order"]
        assert [f.subject for f in reasons] == ["target1", "target2"]


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_gross_outliers_do_not_move_the_answer(robust):
    problem, truth = simulate(paper_scene(order=1, targets=4), noise=PAPER_LOW, seed=5)
    rng = np.random.default_rng(0)
    cameras = []
    for camera in problem.cameras:
        rays = camera.rays
        wrong = rng.random(len(rays.frame)) < 0.1
        turn = rotation.matrix(rotation.exp(np.where(wrong[:, None], 0.1 * rng.normal(size=(len(wrong), 3)), 0.0)))
        away = replace(
            rays,
            direction_cam=(turn @ rays.direction_cam[..., None])[..., 0],
            pixel_from_ray=rays.pixel_from_ray @ np.swapaxes(turn, 1, 2),
        )
        cameras.append(replace(camera, rays=away))
    dirty = replace(problem, cameras=tuple(cameras))
    clean, robustly = (solve(p, SolverSettings(robust=robust)) for p in (problem, dirty))
    naively = solve(dirty, SolverSettings(robust="none"))
    assert error_m(robustly, truth) < 2 * error_m(clean, truth) + 0.3
    assert error_m(naively, truth) > 1.5 * error_m(robustly, truth)
    assert (robustly.sightings.weight < 0.2).mean() > 0.05


def test_too_little_is_refused():
    problem, _ = simulate(paper_scene(order=2, targets=1), noise=PAPER_LOW, seed=0)
    with pytest.raises(GeometryError):
        solve(problem, SolverSettings(method="algorithm-2"))


def test_iteration_limit_is_a_status():
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    solution = solve(problem, SolverSettings(max_iterations=1))
    assert solution.status == "iteration-limit"
    assert "iterations" in solution.message


def test_progress_is_told():
    told: list[tuple[int, float]] = []
    problem, _ = simulate(paper_scene(order=1, targets=2), noise=PAPER_HIGH, seed=0)
    solve(problem, SolverSettings(), progress=lambda i, cost: told.append((i, cost)))
    assert [i for i, _ in told] == list(range(1, len(told) + 1))


def test_candidates_that_end_alike_are_one():
    """Offsets found by search: nothing is called ambiguous because two starts lead to the same answer."""
    scene = paper_scene(order=1, targets=4, offset_frames=8, given_offset_s=None)
    problem, truth = simulate(scene, noise=PAPER_LOW, seed=1)
    solution = solve(problem, SolverSettings(search_s=20.0))
    clock = solution.clock("uav2")
    assert clock.offset_s == pytest.approx(truth.offset_s["uav2"], abs=4 * clock.offset_sigma_s)
    offsets = [c.offset_s["uav2"] for c in solution.offset_candidates]
    assert min(abs(a - b) for i, a in enumerate(offsets) for b in offsets[:i] or [1e3]) > 0.05
    costs = [c.cost for c in solution.offset_candidates]
    assert costs == sorted(costs)
    assert not [f for f in solution.findings if f.kind == "ambiguous-offset"]
