"""The search finds clocks from nothing, and says where it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import OffsetCandidate, SolverSettings
from pipeline.solver.offset_search.search import is_ambiguous, search_offsets
from pipeline.solver.offset_search.sweep import Rays, bounded, crossing_residuals
from pipeline.solver.offset_search.views import Track, cleaned
from scripts.validation.check_offset_search import random_flight

SETTINGS = SolverSettings()


@pytest.mark.parametrize("seed", [0, 3, 6, 11])
def test_random_flights_with_unknown_clocks(seed: int) -> None:
    flight = random_flight(seed)
    found = search_offsets(flight.problem, SETTINGS)
    bottom, sigma = flight.from_truth()
    away = flight.middle_error_s(found[0]) - flight.middle_error_s(bottom)
    assert abs(away) < max(0.05, 3 * sigma)
    assert abs(flight.middle_error_s(found[0])) < max(0.05, 4 * sigma)
    assert found[0].offset_s["uav1"] == 0.0
    assert found[0].frame_rate["uav1"] == flight.problem.cameras[0].frame_rate
    assert list(found) == sorted(found, key=lambda c: c.cost)


def test_a_fifth_of_the_labels_may_be_wrong() -> None:
    flight = random_flight(7, outliers=0.2)
    assert abs(flight.middle_error_s(search_offsets(flight.problem, SETTINGS)[0])) < 0.15


def test_the_order_of_the_motion_need_not_be_known() -> None:
    flight = random_flight(7)
    targets = tuple(replace(t, order="auto") for t in flight.problem.targets)
    found = search_offsets(replace(flight.problem, targets=targets), SETTINGS)
    assert abs(flight.middle_error_s(found[0])) < 0.15


def test_a_valley_with_two_ends_is_flagged() -> None:
    flight = random_flight(48)
    found = search_offsets(flight.problem, SETTINGS)
    assert is_ambiguous(found)
    assert min(abs(flight.middle_error_s(c)) for c in found[:2]) < 0.6


def test_a_given_offset_is_searched_near_only_and_frame_rates_can_be_held() -> None:
    flight = random_flight(6, wrong_rate=0.0)
    first, second = flight.problem.cameras
    near = replace(second, offset_s=flight.offset_s + 0.3, sigma=replace(second.sigma, offset_s=0.3))
    held = replace(SETTINGS, refine_frame_rate=False)
    found = search_offsets(replace(flight.problem, cameras=(first, near)), held)
    assert abs(found[0].offset_s["uav2"] - flight.offset_s) < 0.1
    assert found[0].frame_rate["uav2"] == pytest.approx(second.frame_rate, rel=1e-5)
    wrong = replace(second, offset_s=flight.offset_s + 50.0, sigma=replace(second.sigma, offset_s=0.5))
    for candidate in _found_or_none(replace(flight.problem, cameras=(first, wrong))):
        assert abs(candidate.offset_s["uav2"] - flight.offset_s - 50.0) < 4.0


def _found_or_none(problem: object) -> tuple[OffsetCandidate, ...]:
    try:
        return search_offsets(problem, SETTINGS)  # type: ignore[arg-type]
    except GeometryError:
        return ()


def test_cameras_that_share_no_target_are_refused() -> None:
    flight = random_flight(1)
    first, second = flight.problem.cameras
    renamed = replace(second.rays, targets=tuple(f"other-{t}" for t in second.rays.targets))
    problem = replace(flight.problem, cameras=(first, replace(second, rays=renamed)))
    with pytest.raises(GeometryError, match="target in common") as caught:
        search_offsets(problem, SETTINGS)
    assert caught.value.exit_code == 5


def test_free_motion_that_cannot_overlap_is_refused() -> None:
    flight = random_flight(1)
    targets = tuple(replace(t, motion="spline", order="auto") for t in flight.problem.targets)
    problem = replace(flight.problem, targets=targets)
    with pytest.raises(GeometryError, match="overlap"):
        search_offsets(problem, replace(SETTINGS, search_s=1e-3))


def test_ambiguity_is_a_matter_of_likelihood() -> None:
    one, close, far = (OffsetCandidate(offset_s={}, cost=c) for c in (10.0, 12.0, 40.0))
    assert is_ambiguous((one, close))
    assert not is_ambiguous((one, far))
    assert not is_ambiguous((one,))


def test_rays_that_meet_have_no_residual_and_rays_that_meet_behind_are_no_match() -> None:
    target = np.array([30.0, 200.0, 10.0])
    base = np.array([[100.0, 0.0, 0.0]])
    a, b = target[None], target[None] - base
    ray_a, ray_b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    lifted = np.array([[0.0, 0.0, 3e-3 * np.linalg.norm(b)]]) + b

    def crossing(one: Floats, other: Floats, position_bias_m: float) -> float:
        sigma = np.array([1e-3])
        first = Rays(centre_m=np.zeros((1, 3)), ray=one, sigma_rad=sigma)
        second = Rays(centre_m=base, ray=other / np.linalg.norm(other), sigma_rad=sigma)
        return float(crossing_residuals(first, second, position_bias_m)[0, 0])

    assert abs(crossing(ray_a, ray_b, 0.1)) < 1e-6
    assert np.isinf(crossing(-ray_a, -ray_b, 0.1))
    assert 1.0 < abs(crossing(ray_a, lifted, 0.0)) < 4.0


def test_a_table_of_crossings_is_the_triple_product_over_its_first_order_sigma() -> None:
    rng = np.random.default_rng(5)
    a, b = (rng.normal(size=(n, 3)) for n in (7, 4))
    one, other = (
        Rays(
            centre_m=10 * rng.normal(size=ray.shape),
            ray=ray / np.linalg.norm(ray, axis=1)[:, None],
            sigma_rad=np.full(len(ray), sigma),
        )
        for ray, sigma in ((a, 1e-2), (b, 2e-2))
    )
    table = crossing_residuals(one, other, 0.1)
    base = other.centre_m[:, None] - one.centre_m
    ray_a, ray_b = np.broadcast_to(one.ray, base.shape), np.broadcast_to(other.ray[:, None], base.shape)
    normal = np.cross(ray_a, ray_b)
    lever_a, lever_b = np.cross(ray_a, np.cross(base, ray_b)), np.cross(ray_b, np.cross(base, ray_a))
    variance = 1e-4 * (lever_a**2).sum(-1) + 4e-4 * (lever_b**2).sum(-1) + 0.01 * (normal**2).sum(-1)
    ahead = np.isfinite(table)
    assert 0 < ahead.sum() < table.size
    np.testing.assert_allclose(table[ahead], ((base * normal).sum(-1) / np.sqrt(variance))[ahead], rtol=1e-9)


def test_the_bounded_loss_is_half_a_square_and_then_flat() -> None:
    assert bounded(np.array([0.1]))[0] == pytest.approx(0.005, rel=0.01)
    assert bounded(np.array([1e6]))[0] == pytest.approx(4.5)


def test_labels_that_jump_are_left_out() -> None:
    time = np.arange(100) / 10
    ray = np.stack([0.01 * time, 0 * time, np.ones(100)], axis=1)
    ray[40, 1] += 0.2
    track = Track(
        time_s=time,
        frame=np.arange(100),
        centre_m=np.zeros((100, 3)),
        ray=ray / np.linalg.norm(ray, axis=1, keepdims=True),
        axes=np.tile(np.eye(3), (100, 1, 1)),
        pixel_rad=np.full(100, 1e-3),
    )
    kept = cleaned(track, 0.0)
    assert 40 not in kept.frame
    assert len(kept) == 99
