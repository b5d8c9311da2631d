"""The search's normal matrices are those of the residuals as they are written in the heads of its modules."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry.rotation import skew
from pipeline.records import SolverSettings
from pipeline.solver.observation.observations import across
from pipeline.solver.offset_search import polynomial, polynomial_polish
from pipeline.solver.offset_search.search import search_offsets
from pipeline.solver.offset_search.sweep import SetCamera
from pipeline.solver.offset_search.views import View, views
from scripts.validation.check_offset_search import random_flight
from scripts.validation.check_ordinary_flights import drawn

FLIGHT = random_flight(6)


def two_views() -> tuple[list[View], dict[str, int]]:
    seen = list(views(FLIGHT.problem).values())
    names = sorted({t for v in seen for t in v.tracks})
    return seen, dict(zip(names, (2, 3, 1, 4), strict=False))


def test_normal_matrices_of_a_clock_are_those_of_the_written_out_residuals() -> None:
    seen, orders = two_views()
    target, order = next(iter(orders.items()))
    rows = polynomial.stacked_rows(seen, target, order, 7)
    rng = np.random.default_rng(1)
    u, ranges = rng.uniform(-1, 1, (2, len(rows.time_s))), rng.uniform(50, 300, (2, len(rows.time_s)))
    powers = u[:, None] ** np.arange(2 * order + 1)[:, None]
    motion, coupling, rest = polynomial._normal(rows, powers, ranges, 12)
    for g in range(2):
        design = np.concatenate([_written_out(seen, rows, target, order, 7, u[g], ranges[g])])
        whole = design.T @ design
        n = 3 * (order + 1)
        scale = np.sqrt(np.maximum(np.diagonal(whole), 1e-12))
        found = np.block([[motion[g], coupling[g]], [coupling[g].T, rest[g]]])
        np.testing.assert_allclose(found / scale / scale[:, None], whole / scale / scale[:, None], atol=1e-9)
        assert n == motion.shape[1]


def _written_out(
    seen: list[View], rows: polynomial.Rows, target: str, order: int, most: int, u: Floats, ranges: Floats
) -> Floats:
    """e / sigma of every sighting by [motion, w_1, p_1, w_2, p_2, right-hand side], from the module's head."""
    out, at = [], 0
    for c, view in enumerate(seen):
        track = polynomial.thinned(view.tracks[target], 0.0, most)
        for i in range(len(track)):
            t = across(track.ray[i : i + 1])[0]
            sigma = np.hypot(track.pixel_rad[i], view.attitude_noise_rad)
            spread = np.sqrt(1 + (view.position_noise_m / (ranges[at] * sigma)) ** 2)
            place = t / ranges[at]
            bias = np.zeros((2, 12))
            bias[:, 6 * c : 6 * c + 3] = t @ skew(track.ray[i]) @ track.axes[i]
            bias[:, 6 * c + 3 : 6 * c + 6] = -place
            motion = np.concatenate([place * u[at] ** k for k in range(order + 1)], axis=1)
            right = (place @ track.centre_m[i])[:, None]
            out.append(np.concatenate([motion, bias, right], axis=1) / sigma / spread)
            at += 1
    assert at == len(rows.time_s)
    return np.concatenate(out)


def test_derivatives_of_the_polished_residuals_are_those_of_finite_differences() -> None:
    seen, orders = two_views()
    free = polynomial_polish.ClockPrior(
        clock_scale_sigma=1e-3, allowed=polynomial_polish.ClockRange(low_s=-9.0, high_s=9.0, clock_scale=0.1)
    )
    clocks = np.array([[0.0, 1.0], [FLIGHT.offset_s, 1.0]])
    setup, point = polynomial_polish._start(seen, clocks, [None, free], list(orders), orders, 0.2)
    rng = np.random.default_rng(2)
    point = replace(point, attitude_bias=np.zeros((2, 3)), position_bias=rng.normal(size=(2, 3)))
    held = polynomial_polish._held(setup, point)

    def residuals(step: Floats) -> Floats:
        moved = polynomial_polish._moved(setup, point, step)
        frames = setup.frames[1]
        return np.asarray((held[1].inverse @ polynomial_polish._design(setup, moved, 1, frames)[..., :1]).ravel())

    h = 1e-4 / np.maximum(np.sqrt(np.diagonal(polynomial_polish._normal(setup, point, held)[0])), 1e-2)
    h[:8] = 0.0  # the reference camera is not in these frames
    columns = np.flatnonzero(h)
    steps = [np.where(np.arange(setup.size) == k, h[k], 0.0) for k in columns]
    numeric = np.stack([(residuals(s) - residuals(-s)) / (2 * s.max()) for s in steps], axis=1)
    design = held[1].inverse @ polynomial_polish._design(setup, point, 1, setup.frames[1])
    column, power = setup.unknowns
    u = polynomial_polish._powers(setup, point, 1, setup.frames[1], 4)
    ours = np.stack([(design[..., c] * u[p][:, None]).ravel() for c, p in zip(column, power, strict=True)], axis=1)
    scale = np.linalg.norm(ours, axis=0)
    turned = np.isin(column, (3, 4, 5))
    np.testing.assert_allclose((numeric / scale)[:, ~turned], (ours / scale)[:, ~turned], atol=3e-4)
    # a rotation's derivative leaves out that it moves what was not at right angles: in parts of the residual
    np.testing.assert_allclose((numeric / scale)[:, turned], (ours / scale)[:, turned], atol=0.01)


def test_what_polynomials_of_a_guessed_order_cannot_fit_is_given_up_and_rays_that_cross_decide() -> None:
    flight = random_flight(7)
    asked = tuple(replace(t, order="auto", motion="auto") for t in flight.problem.targets)
    found = search_offsets(replace(flight.problem, targets=asked), SolverSettings())
    assert abs(flight.middle_error_s(found[0])) < 0.15


def test_compiled_sums_over_frames_are_those_of_the_plain_ones() -> None:
    seen, orders = two_views()
    rng = np.random.default_rng(3)
    for orders_now in (orders, dict.fromkeys(orders, 0)):
        clocks = np.array([[0.0, 1.0], [0.3, 1.01]])
        setup, point = polynomial_polish._start(seen, clocks, [None, None], list(orders_now), orders_now, 0.1)
        point = replace(
            point,
            attitude_bias=0.02 * rng.normal(size=(2, 3)),
            position_bias=rng.normal(size=(2, 3)),
            motion=[a + 3.0 * rng.normal(size=a.shape) for a in point.motion],
        )
        held = polynomial_polish._held(setup, point)
        for i in range(2):
            plain, cost = polynomial_polish.frame_sums_plain(setup, point, i, held[i].inverse)
            found, half_square = polynomial_polish._frame_sums(setup, point, i, held[i].inverse)
            scale = np.sqrt(np.maximum(np.diagonal(plain[0]), 1e-9))
            np.testing.assert_allclose(found / scale / scale[:, None], plain / scale / scale[:, None], atol=1e-11)
            assert np.isclose(half_square, cost, rtol=1e-12)


def test_videos_that_do_not_overlap_are_no_guess_where_a_motion_is_guessed() -> None:
    """Two short videos of a car that stops: a parabola fits both best where they never look together."""
    problem = drawn(6200, "gnss10").problem
    found = search_offsets(problem, SolverSettings())
    ends = {c.camera: c.rays.time_s[[0, -1]] for c in problem.cameras}
    for candidate in found:
        low = [ends[name][0] + offset for name, offset in candidate.offset_s.items()]
        high = [ends[name][1] + offset for name, offset in candidate.offset_s.items()]
        assert min(high) - max(low) > 0.05 * (ends["uav1"][1] - ends["uav1"][0])
    assert abs(found[0].offset_s["uav2"] - 1.75) < 1.0


def test_share_in_which_two_cameras_look_together_is_of_the_shorter() -> None:
    seen, _ = two_views()
    low, high = seen[0].span_s
    placed = [SetCamera(view=seen[0], offset_s=0.0, clock_scale=1.0)]
    length = high - low
    mid = np.array([low - length, low, 0.5 * (low + high), high + 0.1 * length])
    np.testing.assert_allclose(polynomial._together(mid, 0.1 * length, placed), [0.0, 0.5, 1.0, 0.0], atol=1e-9)
