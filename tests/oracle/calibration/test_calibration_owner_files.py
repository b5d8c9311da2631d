"""The programs that own a format read ours, and we read theirs.

aniposelib and caliscope bring an OpenCV of their own, so they are not among the project's test requirements: install
one of them in an environment of its own and run this file there. Kalibr and ROS cannot be installed so; their YAML
readers (PyYAML, yaml-cpp) and the checks that Kalibr makes on the fields stand in.
"""

import re

import cv2
import numpy as np
import pytest

from calibration import read_camera, write_camera
from calibration.camera import project
from pipeline.synthetic.board_views import camera

LENSES = [
    camera(distortion=(-0.3, 0.1, 1e-5, -2e-3, 0.01)),
    camera(model="fisheye", distortion=(0.1, 0.01, -1e-5, 1e-7)),
]
POINTS = np.array([[0.1, 0.2, 1.0], [-0.3, 0.1, 2.0], [0.5, -0.4, 3.0]])


def same(found, lens):
    return (
        np.array_equal(found.K, lens.K)
        and np.array_equal(found.distortion, lens.distortion)
        and (found.model, found.image_size) == (lens.model, lens.image_size)
    )


@pytest.mark.parametrize("lens", LENSES)
def test_aniposelib(tmp_path, lens):
    cameras = pytest.importorskip("aniposelib.cameras", reason="aniposelib is not installed: it brings its own OpenCV")
    write_camera(tmp_path / "ours.toml", lens, format_name="aniposelib")
    group = cameras.CameraGroup.load(str(tmp_path / "ours.toml"))
    theirs = group.cameras[0]
    assert np.array_equal(theirs.get_camera_matrix(), lens.K)
    assert tuple(theirs.get_size()) == lens.image_size
    np.testing.assert_allclose(theirs.project(POINTS).reshape(-1, 2), project(lens, POINTS), atol=1e-9)
    group.dump(str(tmp_path / "theirs.toml"))
    assert same(read_camera(tmp_path / "theirs.toml"), lens)


@pytest.mark.parametrize("lens", LENSES)
def test_caliscope(tmp_path, lens):
    module = pytest.importorskip("caliscope.cameras.camera_array", reason="caliscope is not installed: own OpenCV")
    write_camera(tmp_path / "ours.toml", lens, format_name="caliscope")
    array = module.CameraArray.from_toml(tmp_path / "ours.toml")
    theirs = array.cameras[0]
    assert np.array_equal(theirs.matrix, lens.K)
    assert np.array_equal(np.ravel(theirs.distortions), lens.distortion)
    assert (tuple(theirs.size), theirs.fisheye) == (lens.image_size, lens.model == "fisheye")
    array.to_toml(tmp_path / "theirs.toml")
    assert same(read_camera(tmp_path / "theirs.toml"), lens)


@pytest.mark.parametrize("lens", [camera(distortion=(-0.3, 0.1, 1e-5, -2e-3)), LENSES[1]])
def test_kalibr_as_its_reader_checks(tmp_path, lens):
    yaml = pytest.importorskip("yaml", reason="PyYAML, with which Kalibr reads, is not installed")
    write_camera(tmp_path / "chain.yaml", lens, format_name="kalibr")
    fields = yaml.safe_load((tmp_path / "chain.yaml").read_text())["cam0"]
    assert fields["camera_model"] == "pinhole"
    assert all(isinstance(v, float) and v > 0 for v in fields["intrinsics"])
    assert len(fields["intrinsics"]) == 4
    assert fields["distortion_model"] == ("equidistant" if lens.model == "fisheye" else "radtan")
    assert [float(v) for v in fields["distortion_coeffs"]] == lens.distortion.tolist()
    assert all(isinstance(v, float) for v in fields["distortion_coeffs"])
    assert all(isinstance(v, int) for v in fields["resolution"])
    assert isinstance(fields["rostopic"], str)
    (tmp_path / "again.yaml").write_text(yaml.dump({"cam0": fields}))
    assert same(read_camera(tmp_path / "again.yaml"), lens)


@pytest.mark.parametrize("lens", LENSES)
def test_ros_as_its_reader_checks(tmp_path, lens):
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    write_camera(tmp_path / "info.yaml", lens, format_name="ros")
    fields = yaml.safe_load((tmp_path / "info.yaml").read_text())
    for name, shape in (("camera_matrix", (3, 3)), ("rectification_matrix", (3, 3)), ("projection_matrix", (3, 4))):
        part = fields[name]
        assert (part["rows"], part["cols"]) == shape
        assert len(part["data"]) == shape[0] * shape[1]
    terms = fields["distortion_coefficients"]
    assert terms["rows"] * terms["cols"] == len(terms["data"])
    assert fields["distortion_model"] == ("equidistant" if lens.model == "fisheye" else "plumb_bob")
    (tmp_path / "again.yaml").write_text(yaml.dump(fields))
    assert same(read_camera(tmp_path / "again.yaml"), lens)


@pytest.mark.parametrize("name", ["ros", "kalibr", "opencv-yaml"])
def test_small_numbers_are_numbers_in_yaml_1_1(tmp_path, name):
    """YAML 1.1 (PyYAML) takes 1e-05 for a text; a number needs its point: 1.0e-05."""
    write_camera(tmp_path / "c.yaml", camera(distortion=(-0.3, 1e-5, 3e-7, -2e-3)), format_name=name)
    text = (tmp_path / "c.yaml").read_text()
    assert "1.0e-05" in text
    assert not re.search(r"[ \[]-?\d+e", text)
    assert read_camera(tmp_path / "c.yaml").distortion[1] == 1e-5


def test_opencv_projects_the_same_from_our_file(tmp_path):
    lens = LENSES[0]
    write_camera(tmp_path / "c.yml", lens, format_name="opencv-yaml")
    store = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_READ)
    K, D = store.getNode("camera_matrix").mat(), store.getNode("distortion_coefficients").mat()
    pixels, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, D)
    np.testing.assert_allclose(pixels.reshape(-1, 2), project(lens, POINTS), atol=1e-9)
