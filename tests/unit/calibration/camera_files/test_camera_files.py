import json

import numpy as np
import pytest

from calibration import FORMATS, CameraModel, read_camera, write_camera
from calibration.foundation.errors import InputFileError, UsageError
from pipeline.synthetic.board_views import camera

GOOD = {
    "model": "pinhole",
    "image_size": [640, 480],
    "K": [[500, 0, 320], [0, 501, 240], [0, 0, 1]],
    "distortion": [0] * 5,
}


def write(tmp_path, text, name="cam.json"):
    path = tmp_path / name
    path.write_text(text if isinstance(text, str) else json.dumps(text))
    return path


def test_ours_keeps_every_bit_and_the_covariance(tmp_path):
    root = np.random.default_rng(0).normal(size=(9, 9))
    lens = camera()
    full = CameraModel(
        image_size=lens.image_size, K=lens.K, distortion=lens.distortion, rms_px=0.1 / 3, covariance=root @ root.T,
        made={"views": 12, "names": ("a", "b")},
    )  # fmt: skip
    write_camera(tmp_path / "cam.json", full)
    again = read_camera(tmp_path / "cam.json")
    assert np.array_equal(again.K, full.K)
    assert np.array_equal(again.distortion, full.distortion)
    assert again.covariance is not None
    assert again.covariance == pytest.approx(full.covariance, rel=1e-15)
    assert (again.rms_px, again.image_size, again.made["names"]) == (full.rms_px, (640, 480), ["a", "b"])


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    "lens", [camera(distortion=(-0.3, 0.1, 1e-3, -2e-3)), camera(model="fisheye", distortion=(0.1, 0.01, 0, 0))]
)
def test_every_format_comes_back_the_same(tmp_path, name, lens):
    path = tmp_path / ("cam.toml" if name in ("caliscope", "aniposelib") else "cam.txt")
    write_camera(path, lens, format_name=name)
    again = read_camera(path)
    n = len(lens.distortion)
    assert np.array_equal(again.K, lens.K)
    assert np.array_equal(again.distortion[:n], lens.distortion)
    assert not again.distortion[n:].any()
    assert (again.model, again.image_size) == (lens.model, lens.image_size)


def test_a_format_that_cannot_hold_the_lens_refuses(tmp_path):
    with pytest.raises(UsageError, match="at most 4"):
        write_camera(tmp_path / "x.yaml", camera(distortion=(-0.3, 0.1, 0, 0, 0.2)), format_name="kalibr")
    with pytest.raises(UsageError, match="one of json"):
        write_camera(tmp_path / "x.yaml", camera(), format_name="matlab")
    assert not (tmp_path / "x.yaml").exists()


@pytest.mark.parametrize(
    "fields",
    [
        {"K": GOOD["K"], "distortion": [0.1] * 5, "image_size": [640, 480]},
        {"K-matrix": GOOD["K"], "distCoeff": [0.1] * 5, "fps": 25, "resolution": [640, 480]},
        {"camera_matrix": {"rows": 3, "cols": 3, "data": [500, 0, 320, 0, 501, 240, 0, 0, 1]}, "image_width": 640,
         "image_height": 480, "dist_coeffs": [[0.1] * 5]},
        {"intrinsics": {"fx": 500, "fy": 501, "cx": 320, "cy": 240}, "D": [0.1] * 5, "width": 640, "height": 480},
    ],
)  # fmt: skip
def test_other_names_for_the_same_numbers(tmp_path, fields):
    found = read_camera(write(tmp_path, fields))
    assert np.array_equal(found.K, np.array(GOOD["K"], float))
    assert np.array_equal(found.distortion, [0.1] * 5)
    assert found.image_size == (640, 480)


def test_a_missing_image_size_is_allowed_and_said(tmp_path):
    found = read_camera(write(tmp_path, {"K": GOOD["K"], "distortion": []}))
    assert found.image_size == (0, 0)
    assert "image size" in found.made["note"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"K": [[float("nan"), 0, 320], [0, 501, 240], [0, 0, 1]]}, "NaN"),
        ({"K": [[-500, 0, 320], [0, 501, 240], [0, 0, 1]]}, "focal lengths above 0"),
        ({"K": [[500, 0, 320], [0, 501, 240]]}, "3 x 3"),
        ({"K": [[500, 0, 0], [0, 501, 0], [320, 240, 1]]}, "transposed"),
        ({"K": [[500, 3, 320], [0, 501, 240], [0, 0, 1]]}, "skew"),
        ({"K": [[500, 0, 5000], [0, 501, 240], [0, 0, 1]]}, "principal point"),
        ({"K": "wide"}, "not numbers"),
        ({"K": 10**400}, "not numbers"),
        ({"image_size": [10**400, 480]}, "not numbers"),
        ({"distortion": True}, "not numbers"),
        ({"model": []}, "expected pinhole"),
        ({"distortion": [0.1] * 3}, "3 coefficients"),
        ({"distortion": None}, "no distortion"),
        ({"image_size": [640, 0]}, "width and height"),
        ({"image_size": [640.5, 480]}, "width and height"),
        ({"model": "omni"}, "omni"),
        ({"covariance": [[1.0]]}, "9 x 9"),
        ({"covariance": np.diag([-1.0] * 9).tolist()}, "negative variance"),
    ],
)
def test_impossible_cameras_are_named(tmp_path, change, says):
    with pytest.raises(InputFileError, match=says) as error:
        read_camera(write(tmp_path, {**GOOD, **change}))
    assert "cam.json" in str(error.value)
    assert error.value.exit_code == 3


@pytest.mark.parametrize(
    "text",
    [
        "", "   ", json.dumps(GOOD)[:60], "[1, 2]", "{}", "K: [1, 2", "<opencv_storage><K>", "\x00\x01", "hello",
        "&am0:\n  camera_mo_adesol.onon: [640, 480]\n",
    ],
)  # fmt: skip
def test_damaged_files_are_one_clear_message(tmp_path, text):
    with pytest.raises(InputFileError, match="Try:"):
        read_camera(write(tmp_path, text))
    (tmp_path / "cam.yaml").write_text(text)
    with pytest.raises(InputFileError, match="Try:"):
        read_camera(tmp_path / "cam.yaml")


def test_a_missing_file_and_a_binary_one(tmp_path):
    with pytest.raises(InputFileError, match="no such file"):
        read_camera(tmp_path / "none.json")
    (tmp_path / "photo.json").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(InputFileError, match="a photo; expected a text file"):
        read_camera(tmp_path / "photo.json")


def test_one_of_several_cameras_is_chosen_by_name(tmp_path):
    path = write(tmp_path, {"cam0": GOOD, "cam1": {**GOOD, "distortion": [0.5] * 4}})
    with pytest.raises(InputFileError, match="cam0, cam1"):
        read_camera(path)
    assert read_camera(path, camera="cam1").distortion[0] == 0.5
