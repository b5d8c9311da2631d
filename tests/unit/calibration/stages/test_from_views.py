from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibration import calibrate
from calibration.adjustment.bundle import project_with_jacobian
from calibration.boards.view import BoardView
from calibration.foundation.errors import CalibrationError, InputFileError, UsageError
from pipeline.synthetic.board_views import camera, poses, true_corners
from tests.scenes.calibration import BOARD, computed_views


@cache
def good():
    return calibrate(computed_views(camera(), 15), BOARD)


def test_a_good_set_is_good():
    found = good()
    true = np.concatenate([camera().K[[0, 1, 0, 1], [0, 1, 2, 2]], camera().distortion])
    have = np.concatenate([found.camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], found.camera.distortion])
    free = found.sigma > 0
    assert found.verdict == "good"
    assert found.warnings == ()
    assert (np.abs(have - true)[free] < 4 * found.sigma[free]).all()
    assert found.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    assert found.rms_px < found.held_out_px < 1.1 * found.rms_px
    assert found.corner_noise_px == pytest.approx(0.05, rel=0.15)
    assert found.correlation[0, 1] > 0.9
    assert len(found.views) == 15
    assert found.camera.rms_px == pytest.approx(found.rms_px)


def test_five_terms_stay_and_are_honest_where_the_lens_lacks_them():
    plain = calibrate(computed_views(camera(distortion=(0.0,) * 5), 12), BOARD)
    assert plain.lens == "k1 k2 p1 p2 k3"
    assert (np.abs(plain.camera.distortion) < 4 * plain.sigma[4:]).all()


def test_eight_terms_where_five_do_not_do():
    eight = (4.0, 1.5, 0.0, 0.0, 0.2, 4.4, 2.4, 0.5)
    found = calibrate(computed_views(camera(focal=330, distortion=eight), 15, noise_px=0.01), BOARD)
    assert found.lens == "8 terms"
    assert found.held_out_px < 1.1 * 0.01 * np.sqrt(2)


def test_a_fisheye_is_recognised():
    found = calibrate(
        computed_views(camera(focal=260, distortion=(0.05, -0.01, 0.002, 0), model="fisheye"), 12, fill=0.4), BOARD
    )
    assert (found.camera.model, found.lens) == ("fisheye", "fisheye")
    assert abs(found.camera.K[0, 0] - 260) < 4 * found.sigma[0]


def test_a_long_lens_keeps_its_principal_point():
    found = calibrate(computed_views(camera(focal=3000, distortion=(0,) * 5), 12), BOARD, terms="focal")
    assert found.lens == "focal length only"
    assert found.camera.K[0, 2] == 319.5
    assert abs(found.camera.K[0, 0] - 3000) < 4 * found.sigma[0]


def test_bad_views_are_named_and_do_no_harm():
    views = computed_views(camera(), 14)
    random = np.random.default_rng(0)
    views[3] = replace(views[3], corners=views[3].corners + random.normal(0, 1, (54, 2)))
    views[7] = replace(views[7], corners=views[7].corners * [1.02, 1.0])
    found = calibrate(views, BOARD)
    assert {r.name for r in found.rejected} == {"view03.png", "view07.png"}
    assert abs(found.camera.K[0, 0] - 540) < 4 * found.sigma[0]
    assert any("view03.png" in words for words in found.warnings)


def test_a_bent_board_is_found_and_its_shape_taken_in():
    points = BOARD.points_m
    bend = np.zeros_like(points)
    bend[:, 2] = 0.0012 * ((points[:, 0] - 0.1) / 0.1) ** 2
    seen, random = camera(), np.random.default_rng(0)
    views = [
        BoardView(
            name=f"v{i}", image_size=seen.image_size, index=np.arange(54),
            corners=true_corners(seen, BOARD, pose, bend) + random.normal(0, 0.03, (54, 2)),
        )
        for i, pose in enumerate(poses(14, 1, seen, BOARD))
    ]  # fmt: skip
    found = calibrate(views, BOARD)
    assert found.bend_m is not None
    assert any("not flat" in words for words in found.warnings)
    assert found.rms_px == pytest.approx(0.03 * np.sqrt(2), rel=0.15)
    assert abs(found.camera.K[0, 0] - 540) < 4 * found.sigma[0]


def rolling(count: int, turn_rad: float):
    """Views taken while the camera turned, row after row."""
    seen, random = camera(), np.random.default_rng(0)
    intrinsics = np.concatenate([seen.K[[0, 1, 0, 1], [0, 1, 2, 2]], seen.distortion])
    for i, (R, t) in enumerate(poses(count, 1, seen, BOARD)):
        still = BOARD.points_m @ R.T + t
        pixels, turn = project_with_jacobian("pinhole", intrinsics, still)[0], random.normal(0, turn_rad, 3)
        for _ in range(5):
            tau = pixels[:, 1:] / 480 - 0.5
            pixels = project_with_jacobian("pinhole", intrinsics, still + tau * np.cross(turn, still))[0]
        noisy = pixels + random.normal(0, 0.04, pixels.shape)
        yield BoardView(name=f"v{i}", image_size=(640, 480), corners=noisy, index=np.arange(54))


def test_a_rolling_shutter_is_named_and_the_covariance_says_so():
    found = calibrate(list(rolling(15, 0.006)), BOARD)
    assert found.verdict == "poor"
    assert any("rolling shutter" in words for words in found.warnings)
    assert found.inflation > 5
    assert abs(found.camera.K[0, 0] - 540) < 4 * found.sigma[0]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_views(count):
    with pytest.raises(CalibrationError, match="at least 3") as error:
        calibrate(computed_views(camera(), 4)[:count], BOARD)
    assert error.value.exit_code == 5


def test_few_views_are_flagged():
    found = calibrate(computed_views(camera(), 3), BOARD)
    assert found.verdict == "poor"
    assert "only 3 views" in found.warnings[0]
    assert found.advice[-1] == "12 more views"


@pytest.mark.parametrize("tilt_deg", [0.0, 2.0])
def test_boards_that_all_face_the_camera_are_refused(tilt_deg):
    with pytest.raises(CalibrationError, match="face the camera"):
        calibrate(computed_views(camera(), 12, tilt_deg=tilt_deg), BOARD)


def test_one_corner_of_the_image_is_refused():
    seen, random = camera(1280, 960, 1080.0), np.random.default_rng(0)
    true = (true_corners(seen, BOARD, pose) for pose in poses(300, 3, seen, BOARD, fill=0.15))
    inside = [c for c in true if (c.max(axis=0) < (560, 420)).all()][:10]
    views = [
        BoardView(
            name=f"v{i}", image_size=(1280, 960), corners=c + random.normal(0, 0.03, c.shape), index=np.arange(54)
        )
        for i, c in enumerate(inside)
    ]
    with pytest.raises(CalibrationError, match="upper left"):
        calibrate(views, BOARD)


def test_two_cameras_in_one_folder_are_told_apart():
    one = [replace(v, name=f"a{i}") for i, v in enumerate(computed_views(camera(), 8))]
    other = [replace(v, name=f"b{i}") for i, v in enumerate(computed_views(camera(focal=600), 8, seed=5))]
    with pytest.raises(CalibrationError, match="two cameras") as error:
        calibrate(one + other, BOARD)
    groups = str(error.value).split("fit a focal length")
    assert "600" in str(error.value)
    assert "540" in str(error.value)
    assert ("a0" in groups[0]) != ("b0" in groups[0])


def test_mixed_sizes_name_the_odd_ones():
    odd = replace(computed_views(camera(), 1)[0], name="odd.png", image_size=(800, 600))
    views = [*computed_views(camera(), 5), odd]
    with pytest.raises(InputFileError, match=r"odd\.png \(800x600\)"):
        calibrate(views, BOARD)


def test_unknown_terms():
    with pytest.raises(UsageError, match="auto"):
        calibrate(computed_views(camera(), 3), BOARD, terms="7")


def test_partial_views_count_too():
    views = [
        replace(v, corners=v.corners[i % 3 : 40 + i], index=v.index[i % 3 : 40 + i])
        for i, v in enumerate(computed_views(camera(), 12))
    ]
    found = calibrate(views, BOARD)
    assert abs(found.camera.K[0, 0] - 540) < 4 * found.sigma[0]
