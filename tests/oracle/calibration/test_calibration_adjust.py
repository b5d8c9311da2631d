"""The adjustment against OpenCV's, its derivatives against differences, its uncertainty against many draws."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.adjustment.bundle import Fit, Model, adjust, jacobians, project_all, stacked
from calibration.adjustment.covariance import believed, corner_noise_px, held_out_px, uncertainty
from calibration.adjustment.initialisation import first_fit
from pipeline.synthetic.board_views import camera, poses, true_corners
from tests.scenes.calibration import BOARD, computed_views

MIDDLE = BOARD.points_m - BOARD.points_m.mean(axis=0)
FULL = Model(lens="pinhole", free=np.ones(9, bool), board_m=MIDDLE)


def fitted(views, model=FULL):
    corners = stacked(views)
    return corners, adjust(model, first_fit(model, corners, views[0].image_size), corners)


def test_same_minimum_as_opencv():
    views = computed_views(camera(), 10, seed=2, noise_px=0.3)
    corners, fit = fitted(views)
    rms, K, distortion, *_ = cv2.calibrateCamera(
        [MIDDLE.astype(np.float32)] * 10, [v.corners.astype(np.float32) for v in views], (640, 480), None, None
    )
    assert fit.converged
    assert fit.rms_px == pytest.approx(rms, rel=1e-5)
    np.testing.assert_allclose(fit.intrinsics[:4], K[[0, 1, 0, 1], [0, 1, 2, 2]], atol=0.02)
    np.testing.assert_allclose(fit.intrinsics[4:], distortion.ravel(), atol=2e-3)
    assert len(corners.xy) == 540


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_derivatives_are_those_of_differences(lens):
    random = np.random.default_rng(0)
    seen = camera(focal=300, distortion=(0.05, 0.01, 0, 0), model=lens) if lens == "fisheye" else camera()
    views = computed_views(seen, 3)
    corners = stacked(views)
    free = np.ones(4 + len(seen.distortion), bool)
    model = Model(lens=lens, free=free, board_m=MIDDLE, board_sigma_m=(1, 1, 1), turning=True)
    placed = poses(3, 1, seen, BOARD)
    fit = Fit(
        intrinsics=np.concatenate([seen.K[[0, 1, 0, 1], [0, 1, 2, 2]], seen.distortion]),
        rotation=np.stack([R for R, _ in placed]),
        translation_m=np.stack([t + R @ BOARD.points_m.mean(axis=0) for R, t in placed]),
        turn_rad=random.normal(0, 0.01, (3, 3)),
        bend_m=random.normal(0, 1e-4, MIDDLE.shape),
        residual_px=np.zeros_like(corners.xy),
        weight=np.ones(len(corners.xy)),
    )
    _, shared, own = jacobians(model, fit, corners)
    q, view = len(free), corners.view

    def moved(**change):
        return project_all(model, replace(fit, **change), corners)[0]

    for i in range(q):
        step = np.zeros(q)
        step[i] = 1e-6 * max(1.0, abs(fit.intrinsics[i]))
        numeric = (moved(intrinsics=fit.intrinsics + step) - moved(intrinsics=fit.intrinsics - step)) / (2 * step[i])
        np.testing.assert_allclose(shared[:, :, i], numeric, rtol=1e-5, atol=1e-5)
    step = np.zeros_like(fit.bend_m)
    step[20, 2] = 1e-7
    numeric = (moved(bend_m=fit.bend_m + step) - moved(bend_m=fit.bend_m - step)) / 2e-7
    np.testing.assert_allclose(shared[:, :, q + 62], numeric, rtol=1e-5, atol=1e-3)
    for i in range(3):
        w = np.eye(3)[i] * 1e-6
        turned = [np.stack([cv2.Rodrigues(s * w)[0] @ R for R in fit.rotation]) for s in (1, -1)]
        numeric = (moved(rotation=turned[0]) - moved(rotation=turned[1])) / 2e-6
        np.testing.assert_allclose(own[:, :, i], numeric, rtol=1e-4, atol=1e-2)
        numeric = (moved(translation_m=fit.translation_m + w) - moved(translation_m=fit.translation_m - w)) / 2e-6
        np.testing.assert_allclose(own[:, :, 3 + i], numeric, rtol=1e-5, atol=1e-2)
        numeric = (moved(turn_rad=fit.turn_rad + w) - moved(turn_rad=fit.turn_rad - w)) / 2e-6
        np.testing.assert_allclose(own[:, :, 6 + i], numeric, rtol=1e-5, atol=1e-2)
    assert len(view) == 162


def test_held_out_error_is_that_of_a_fit_without_the_view():
    views = computed_views(camera(), 7, seed=4, noise_px=0.2)
    corners, fit = fitted(views)
    worth = uncertainty(FULL, fit, corners, 1e-3)
    quick = held_out_px(FULL, fit, corners, worth.without_view)
    for v in (0, 3):
        _, rest = fitted(views[:v] + views[v + 1 :])
        sigma = np.sqrt(np.diag(worth.covariance))
        np.testing.assert_array_less(np.abs(worth.without_view[v] - rest.intrinsics), 0.3 * sigma)
        exact = held_out_px(FULL, fit, corners, np.tile(rest.intrinsics, (7, 1)))[v]
        assert quick[v] == pytest.approx(exact, rel=0.02)


def test_claimed_sigmas_are_true_and_grow_when_views_share_errors():
    random = np.random.default_rng(3)
    seen = camera(distortion=(-0.28, 0.09, 0.0008, -0.0006, 0.05))
    true = np.concatenate([seen.K[[0, 1, 0, 1], [0, 1, 2, 2]], seen.distortion])
    clean = computed_views(seen, 12, seed=1, noise_px=0)
    start = fitted(clean)[1]
    off, plain, shared = [], [], []
    for _ in range(60):
        views = [replace(v, corners=v.corners + random.normal(0, 0.05, v.corners.shape)) for v in clean]
        corners = stacked(views)
        fit = adjust(FULL, start, corners)
        worth = uncertainty(FULL, fit, corners, 1e-4)
        off.append((fit.intrinsics - true) / np.sqrt(np.diag(worth.covariance) / max(1.0, worth.inflation)))
        plain.append(worth.inflation)
    z = np.sqrt(np.mean(np.square(off), axis=0))
    assert (z > 0.75).all()
    assert (z < 1.28).all()
    assert np.mean(plain) == pytest.approx(1.0, abs=0.1)
    for _ in range(8):
        views = [replace(v, corners=v.corners * (1 + random.normal(0, 3e-4, 2))) for v in clean]
        corners = stacked(views)
        fit = adjust(FULL, start, corners)
        shared.append(uncertainty(FULL, fit, corners, 1e-4).inflation)
    assert np.mean(shared) > 5


def test_less_exact_views_and_wild_corners_weigh_less_and_the_sigmas_stay_true():
    random = np.random.default_rng(5)
    seen = camera(distortion=(-0.28, 0.09, 0.0008, -0.0006, 0.05))
    true = np.concatenate([seen.K[[0, 1, 0, 1], [0, 1, 2, 2]], seen.distortion])
    clean = computed_views(seen, 12, seed=1, noise_px=0)
    start = fitted(clean)[1]
    pulls, plain = [], []
    for _ in range(40):
        noise = [random.normal(0, 0.2 if i in (3, 8) else 0.02, (54, 2)) for i in range(12)]
        noise[5][7] += (0.6, -0.4)
        corners = stacked([replace(v, corners=v.corners + n) for v, n in zip(clean, noise, strict=True)])
        first = adjust(FULL, start, corners)
        weighed = believed(first, corners)
        fit = adjust(FULL, first, weighed)
        assert weighed.weight[corners.rows(3)].max() < 0.1
        assert weighed.weight[corners.rows(0)].min() > 0.4
        assert weighed.weight[corners.rows(5)][7] < 0.3
        worth = uncertainty(FULL, fit, weighed, 1e-4)
        pulls.append((fit.intrinsics - true) / np.sqrt(np.diag(worth.covariance)))
        plain.append((first.intrinsics - true) / np.sqrt(np.diag(worth.covariance)))
    z = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert (z > 0.65).all()
    assert (z < 1.3).all()
    assert np.sqrt(np.mean(np.square(plain))) > 1.8 * np.sqrt(np.mean(np.square(pulls)))


def test_corner_noise_is_seen_without_knowing_the_lens():
    seen = camera(focal=300, distortion=(-0.3, 0.1, 0, 0, 0))
    placed = poses(8, 1, seen, BOARD)
    random = np.random.default_rng(0)
    grids = [(true_corners(seen, BOARD, p) + random.normal(0, 0.1, (54, 2))).reshape(6, 9, 2) for p in placed]
    assert corner_noise_px(grids) == pytest.approx(0.1, rel=0.1)
