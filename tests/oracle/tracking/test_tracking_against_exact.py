"""The pieces of tracking against exact answers: known warps, homographies, finite differences, a textbook filter."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.tracking.scene.background import advance, first_background, moved
from pipeline.tracking.target import _kernels, alignment
from pipeline.tracking.target.kinematics import carried, corrected, first_course
from pipeline.tracking.target.template import Patch, Warp, adapted, first_template


def smooth_noise(seed: int, height: int, width: int, grain: int = 5) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(20, 230, (height // grain + 3, width // grain + 3, 3)).astype(np.float32)
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 255)


def seen_under(
    image: np.ndarray, linear: np.ndarray, shift: np.ndarray, about: np.ndarray, fine: int = 3
) -> np.ndarray:
    """The image after x -> about + linear (x - about) + shift, area-averaged from a finer grid."""
    forward = np.column_stack([linear, about + shift - linear @ about])
    grid = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2]])
    full = grid @ np.vstack([forward, [0, 0, 1]])
    size = image.shape[1] * fine, image.shape[0] * fine
    large = cv2.warpAffine(image, full, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    small = cv2.resize(large, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    return np.clip(np.rint(small), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(6))
def test_alignment_finds_a_known_affine_warp(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = smooth_noise(seed, 120, 140)
    centre = np.array([70.0, 60.0]) + rng.uniform(-0.5, 0.5, 2)
    linear = np.eye(2) + rng.normal(0, 0.02, (2, 2))
    shift = rng.uniform(-2, 2, 2)
    template = first_template(seen_under(image, np.eye(2), np.zeros(2), centre), centre, (30.0, 22.0))
    now = seen_under(image, linear, shift, centre)
    found = alignment.align(now, template, Warp(linear=np.eye(2), centre_px=centre), np.eye(2), looseness=3.0)
    assert np.abs(found.warp.centre_px - (centre + shift)).max() < 0.04
    assert np.abs(found.warp.linear - linear).max() < 0.02
    assert found.score > 0.97
    assert found.agreeing > 0.95
    assert found.inside == 1.0


def test_alignment_sigma_follows_the_noise() -> None:
    image, centre = smooth_noise(3, 120, 140), np.array([70.0, 60.0])
    errors, sigmas = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        clean = seen_under(image, np.eye(2), np.zeros(2), centre)
        noisy = np.clip(clean + rng.normal(0, 9, clean.shape), 0, 255).astype(np.uint8)
        template = first_template(clean, centre, (24.0, 18.0))
        found = alignment.align(noisy, template, Warp(linear=np.eye(2), centre_px=centre + 0.4), np.eye(2))
        errors.append(found.warp.centre_px - centre)
        sigmas.append(np.sqrt(np.trace(found.covariance_px2) / 2))
    assert 0.2 < np.sqrt(np.mean(np.square(errors))) / np.mean(sigmas) < 1.25


def test_covered_pixels_lose_their_say() -> None:
    image, centre = smooth_noise(5, 120, 140), np.array([70.0, 60.0])
    template = first_template(image.astype(np.uint8), centre, (30.0, 22.0))
    now = seen_under(image, np.eye(2), np.array([0.6, -0.3]), centre)
    now[:, :61] = 128
    found = alignment.align(now, template, Warp(linear=np.eye(2), centre_px=centre), np.eye(2))
    assert np.abs(found.warp.centre_px - (centre + np.array([0.6, -0.3]))).max() < 0.25
    assert found.agreeing < 0.95


def test_step_columns_are_the_derivatives_of_the_warped_template() -> None:
    image, centre = smooth_noise(8, 120, 140, grain=12).astype(np.uint8), np.array([70.0, 60.0])
    template = first_template(image, centre, (30.0, 22.0))
    columns = alignment._columns(template).reshape(10, *template.shape, 3)[:6]
    patch = Patch.cut(image, Warp(linear=np.eye(2), centre_px=centre), template.shape, template.step_px, 5.0)
    generators = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]], float)
    inner = (slice(3, -3), slice(3, -3))
    for k in range(6):
        step = 0.5 if k < 2 else 0.03
        shift = np.eye(2)[k] * step if k < 2 else np.zeros(2)
        change = generators[k - 2] * step if k >= 2 else np.zeros((2, 2))
        sides = [patch.at(Warp(linear=np.eye(2) + s * change, centre_px=centre + s * shift)) for s in (1, -1)]
        numeric = (sides[0] - sides[1]) / (2 * step)
        error = np.abs(numeric[inner] - columns[k][inner]).max()
        assert error < 0.12 * np.abs(columns[k][inner]).max(), k


def test_background_motion_is_the_homography_between_frames() -> None:
    ground = smooth_noise(2, 460, 760, grain=9)
    true_map = np.array([[1.01, 0.012, 4.0], [-0.010, 0.995, -3.0], [2e-5, -1e-5, 1.0]])
    before = ground[50:410, 50:690].astype(np.uint8)
    shifted = np.array([[1, 0, 50], [0, 1, 50], [0, 0, 1.0]])
    after = cv2.warpPerspective(ground, true_map @ np.linalg.inv(shifted), (640, 360)).clip(0, 255).astype(np.uint8)
    after[100:160, 200:280] = (200, 30, 30)  # something that moves on its own
    _, found = advance(first_background(before), after)
    for x, y in [(100, 80), (320, 180), (540, 300)]:
        exact, jacobian = moved(true_map, np.array([x, y], float))
        got, its_jacobian = moved(found, np.array([x, y], float))
        assert np.abs(got - exact).max() < 0.3
        assert np.abs(its_jacobian - jacobian).max() < 0.005


def test_moved_gives_the_derivative() -> None:
    H = np.array([[1.1, 0.1, 5.0], [-0.05, 0.9, 2.0], [1e-4, -2e-4, 1.0]])
    at, h = np.array([120.0, 80.0]), 1e-4
    _, jacobian = moved(H, at)
    numeric = np.column_stack([(moved(H, at + d)[0] - moved(H, at - d)[0]) / (2 * h) for d in np.eye(2) * h])
    np.testing.assert_allclose(jacobian, numeric, atol=1e-8)


def test_course_is_a_kalman_filter_that_finds_constant_velocity() -> None:
    rng = np.random.default_rng(1)
    position, velocity, dt = np.array([100.0, 50.0]), np.array([40.0, -25.0]), 0.04
    course = first_course(position, 20.0)
    normed = []
    for _ in range(100):
        course, _ = carried(course, np.eye(3), dt)
        position = position + velocity * dt
        normed.append((course.position_px - position) / course.sigma_px)
        course = corrected(course, position + rng.normal(0, 0.1, 2), 0.1)
    assert np.abs(course.velocity - velocity).max() < 15.0
    assert np.abs(course.position_px - position).max() < 0.3
    assert np.sqrt(np.mean(np.square(normed[10:]))) < 1.0


def test_hidden_course_grows_uncertain_and_keeps_going() -> None:
    course = corrected(first_course(np.array([10.0, 10.0]), 20.0), np.array([10.0, 10.0]), 0.1)
    before = course.sigma_px
    drift = np.array([[1, 0, 2.0], [0, 1, 1.0], [0, 0, 1]])
    for _ in range(10):
        course, _ = carried(course, drift, 0.04)
    np.testing.assert_allclose(course.position_px, [30.0, 20.0], atol=1e-9)
    assert course.sigma_px > 5 * before


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.skipif(not _kernels.AVAILABLE, reason="needs the extra 'fast' (numba)")
def test_compiled_alignment_is_the_plain_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = smooth_noise(seed, 120, 140)
    centre = np.array([70.0, 60.0]) if seed < 5 else np.array([14.0, 60.0 + 50 * (seed - 6)])
    template = first_template(image.astype(np.uint8), centre, (26.0 + seed, 20.0))
    template = adapted(template, template.pixels, rng.uniform(0, 900, template.shape).astype(np.float32), 0.02, 0.3)
    now = seen_under(image, np.eye(2) + rng.normal(0, 0.02, (2, 2)), rng.uniform(-1.5, 1.5, 2), centre)
    now[:, :50] = now[:, :50] // 2  # a part that disagrees
    start = Warp(linear=np.eye(2), centre_px=centre + rng.uniform(-0.5, 0.5, 2))
    patch = Patch.cut(now, start, template.shape, template.step_px, 5.0)
    plain, compiled = (
        way(now, template, patch, start, np.eye(2), 2.0)
        for way in (alignment.aligned_plain, alignment.aligned_compiled)
    )
    np.testing.assert_allclose(compiled.warp.centre_px, plain.warp.centre_px, atol=2e-3)
    np.testing.assert_allclose(compiled.warp.linear, plain.warp.linear, atol=2e-3)
    np.testing.assert_allclose(compiled.covariance_px2, plain.covariance_px2, rtol=0.02)
    np.testing.assert_allclose(compiled.seen, plain.seen, atol=0.5)
    assert compiled.score == pytest.approx(plain.score, abs=2e-3)
    assert compiled.agreeing == pytest.approx(plain.agreeing, abs=0.02)
    assert compiled.inside == pytest.approx(plain.inside, abs=1e-9)
