"""OpenCV's own reader and writer on the same files."""

import cv2
import numpy as np
import pytest

from calibration import read_camera, write_camera
from pipeline.synthetic.board_views import camera


@pytest.mark.parametrize(("name", "suffix"), [("opencv-yaml", ".yml"), ("opencv-xml", ".xml")])
def test_opencv_reads_what_we_write(tmp_path, name, suffix):
    path = tmp_path / f"cam{suffix}"
    write_camera(path, camera(), format_name=name)
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert np.array_equal(store.getNode("camera_matrix").mat(), camera().K)
    assert np.array_equal(store.getNode("distortion_coefficients").mat().ravel(), camera().distortion)
    assert store.getNode("image_width").real() == 640


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_we_read_what_opencv_writes(tmp_path, suffix):
    path = tmp_path / f"cam{suffix}"
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    store.write("image_width", 640)
    store.write("image_height", 480)
    store.write("camera_matrix", camera().K)
    store.write("distortion_coefficients", camera().distortion.reshape(-1, 1))
    store.release()
    found = read_camera(path)
    np.testing.assert_array_equal(found.K, camera().K)
    np.testing.assert_array_equal(found.distortion, camera().distortion)
    assert found.image_size == (640, 480)
