"""What carries an offset, read from the solved covariance: the same as from the rays, and whole after a solve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.solver import solve
from pipeline.solver.observability.offset_knowledge import WORDS, offset_knowledge, solved_offset_knowledge
from pipeline.solver.observability.ray_bundles import Bundle, by_chance, slides_along_rays
from pipeline.solver.offset_search.views import views
from tests.unit.solver.observability.test_findings import CAR, CURVED, MAP, SIGMA, STILL_SOUTH, VAN, Cam, poly, scene

TURNING = [poly([0, 0, 0], [8, 3, 0], [-1.5, 1.0, 0]), poly([20, 10, 0], [-4, 7, 0], [1.0, 1.5, 0])]
TOLD = replace(SIGMA, offset_s=0.1)


@pytest.mark.parametrize(
    ("targets", "order", "sigma"),
    [([CAR], 1, SIGMA), ([CAR, VAN], 1, TOLD), (TURNING, 2, SIGMA)],
    ids=["constant velocity", "two, offset told", "turning"],
)
def test_the_covariance_says_what_the_rays_say(targets, order, sigma) -> None:
    cams = [Cam(CURVED), Cam(STILL_SOUTH, offset_s=0.3, tell_offset=True, sigma=sigma)]
    problem = scene(cams, targets, order=order)
    solution = solve(problem, replace(MAP, robust="none"))
    seen, clocks = list(views(problem).values()), [(c.offset_s, c.nominal_rate / c.frame_rate) for c in solution.clocks]
    orders = {t.target: order for t in problem.targets}
    (rays,) = offset_knowledge(problem.cameras, seen, clocks, orders, MAP, "cam0")
    (solved,) = solved_offset_knowledge(
        problem.cameras, seen, clocks, solution.shared_names, solution.shared_covariance
    )
    assert solved.sigma_s == pytest.approx(rays.sigma_s, rel=0.15)
    for kind in WORDS:
        assert solved.growth[kind] == pytest.approx(rays.growth[kind], rel=0.2), kind


def test_a_wider_prior_is_that_of_the_wider_problem() -> None:
    cams = [Cam(CURVED), Cam(STILL_SOUTH, offset_s=0.3, tell_offset=True)]
    wide = replace(SIGMA, position_bias_m=10 * SIGMA.position_bias_m)
    sigmas = []
    for told in (SIGMA, wide):
        problem = scene(cams, [CAR])
        problem = replace(problem, cameras=tuple(replace(c, sigma=told) for c in problem.cameras))
        solution = solve(problem, replace(MAP, robust="none"))
        clocks = [(c.offset_s, c.nominal_rate / c.frame_rate) for c in solution.clocks]
        (known,) = solved_offset_knowledge(
            problem.cameras,
            list(views(problem).values()),
            clocks,
            solution.shared_names,
            solution.shared_covariance,
        )
        sigmas.append(known)
    assert sigmas[0].growth["position"] == pytest.approx(sigmas[1].sigma_s / sigmas[0].sigma_s, rel=0.05)


def weighted_search(bundle: Bundle, order: int) -> bool:
    """All weightings, without the shortcut: the sum minimised by plain numpy, axis by axis."""
    m = len(bundle.time_s)
    u = (bundle.time_s - bundle.time_s.mean()) / np.ptp(bundle.time_s)
    powers = u[:, None] ** np.arange(order + 1)
    across = np.eye(3) - bundle.ray[:, :, None] * bundle.ray[:, None, :]
    design = np.einsum("mk,mij->mikj", powers, across).reshape(m, 3, -1)
    motion = np.einsum("mk,ij->mikj", powers, np.eye(3)).reshape(m, 3, -1)
    length, best = np.ones(m), np.inf
    for _ in range(8):
        top = np.einsum("mia,mib->ab", design, design / (bundle.sigma_rad * length)[:, None, None] ** 2)
        bottom = np.einsum("mia,mib->ab", motion, motion / length[:, None, None] ** 2)
        value, vector = np.linalg.eig(np.linalg.solve(bottom, top))
        a = vector[:, value.real.argmin()].real
        size = np.linalg.norm(motion @ a, axis=1)
        length = np.maximum(size, 0.02 * np.sqrt((size**2).mean()))
        best = min(best, float((((design @ a) ** 2).sum(1) / (bundle.sigma_rad * length) ** 2).sum()))
    return by_chance(best, max(2 * m - 3 * (order + 1) + 1, 1))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_shortcut_finds_the_same_sliding_bundles(order: int) -> None:
    """From bundles that slide along one motion to ones that are bent away from it, little by little."""
    rng = np.random.default_rng(order)
    time = np.linspace(0, 5, 40)
    found = []
    for bend in (0.0, 0.3, 1.0, 2.0, 4.0, 10.0, 30.0, 300.0):
        along = (time[:, None] ** np.arange(order + 1)) @ (rng.normal(size=(order + 1, 3)) * 5) + [0, 0, 60]
        along[:, 0] += bend * np.sin(2.0 * time)
        ray = along / np.linalg.norm(along, axis=1, keepdims=True) + rng.normal(0, 2e-3, (40, 3))
        bundle = Bundle(
            time_s=time,
            centre_m=rng.normal(size=(40, 3)),
            ray=ray / np.linalg.norm(ray, axis=1, keepdims=True),
            sigma_rad=np.full(40, 2e-3),
            bias_rad=1e-3,
            position_bias_m=1.0,
            camera=np.zeros(40),
        )
        found.append(slides_along_rays(bundle, order))
        assert found[-1] == weighted_search(bundle, order), bend
    assert found[0]
    assert not found[-1]
