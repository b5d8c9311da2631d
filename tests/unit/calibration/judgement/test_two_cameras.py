"""Two cameras in one folder: told from one camera, from a shutter that rolls, from photos that were turned."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import CameraModel, calibrate
from calibration.adjustment.bundle import stacked
from calibration.adjustment.model_selection import fitted
from calibration.foundation.errors import CalibrationError
from calibration.judgement.two_cameras import like_cameras
from tests.scenes.calibration import BOARD, computed_views


def lens(focal=1100.0, cx=640.0, cy=478.0):
    terms = [-0.25, 0.08, 0.0005, -0.0004, -0.01]
    return CameraModel(image_size=(1280, 960), K=[[focal, 0, cx], [0, focal, cy], [0, 0, 1]], distortion=terms)


def asked(views):
    board_m = BOARD.points_m - BOARD.points_m.mean(axis=0)
    best = fitted("5", stacked(views), views[0].image_size, board_m)
    return like_cameras(best.model, best.fit, views)


def test_principal_points_a_few_pixels_apart_are_two_cameras():
    views = [*computed_views(lens(), 8, seed=2, noise_px=0.03)]
    views += [
        replace(v, name=f"b{v.name}") for v in computed_views(lens(1103.0, 643.0, 476.0), 6, seed=3, noise_px=0.03)
    ]
    found = asked(views)
    assert found is not None
    right = np.mean(found.first == (np.arange(14) < 8))
    assert max(right, 1 - right) > 0.9  # a view square to the camera fits either
    apart = found.intrinsics[0] - found.intrinsics[1]
    np.testing.assert_allclose(np.abs(apart[2:]), [3, 2], atol=1.0)
    assert not found.turned
    with pytest.raises(CalibrationError, match=r"two cameras.*fit a focal length of 110.*each group on its own"):
        calibrate(views, BOARD)


def test_one_camera_is_one():
    assert asked(computed_views(lens(), 12, seed=4, noise_px=0.1)) is None


def one_bent_view(seed):
    """Nine views of one camera, the first drawn out along its columns, by a fifth of a pixel at the image's edge."""
    views = computed_views(lens(), 9, seed=seed, noise_px=0.01)
    along = np.array([0, 0.25]) * (views[0].corners - [640, 480]) / 640
    return [replace(views[0], corners=views[0].corners + along), *views[1:]]


@pytest.mark.parametrize("seed", [9, 10, 15])
def test_one_bad_view_is_no_second_camera(seed):
    found = asked(one_bent_view(seed))
    assert found is not None, "otherwise this shows nothing"
    assert found.bad_view == 0


def test_the_view_that_passes_for_a_second_camera_is_set_aside_and_said(monkeypatch):
    monkeypatch.setattr("calibration.stages.from_views.contradicting", lambda model, fit, views, _: (views, [], fit))
    views = one_bent_view(10)
    found = calibrate(views, BOARD)
    assert [r.name for r in found.rejected] == [views[0].name]
    assert "contradicts the other views" in found.rejected[0].reason
    np.testing.assert_allclose(found.camera.K[:2, 2], [640, 478], atol=0.2)


def test_what_scatters_from_view_to_view_is_no_second_camera():
    random = np.random.default_rng(5)
    rolled = [
        replace(v, corners=v.corners + (v.corners[:, 1:] / 960 - 0.5) * random.normal(0, 3, 2))
        for v in computed_views(lens(), 12, seed=5, noise_px=0.03)
    ]
    assert asked(rolled) is None


def test_photos_turned_by_180_degrees_are_told():
    views = computed_views(lens(1100, 655, 470), 14, seed=6, noise_px=0.03)
    size = np.array(views[0].image_size)
    turned = [replace(v, corners=(size - 1 - v.corners)[::-1]) if i % 2 else v for i, v in enumerate(views)]
    with pytest.raises(CalibrationError, match="turned by 180 degrees"):
        calibrate(turned, BOARD)
