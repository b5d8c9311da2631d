"""Real photos, beside what others published for them."""

from pathlib import Path

import pytest

from calibration import Board, calibrate_files, read_camera

REAL = Path(__file__).resolve().parents[4] / "shared" / "real"
PHOTOS = REAL / "calibration"

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not PHOTOS.is_dir(), reason="no real photos at ../shared/real/calibration"),
]


def test_opencv_left():
    folder = PHOTOS / "opencv-left"
    found = calibrate_files([folder], Board(cols=9, rows=6, square_m=0.025))
    published = read_camera(folder / "left_intrinsics.yml")
    assert len(found.views) == 13
    assert found.rms_px <= 0.10
    assert found.verdict == "usable"
    assert 532 <= found.camera.K[0, 0] <= 537
    assert found.camera.K[0, 0] == pytest.approx(published.K[0, 0], rel=0.005)
    assert any("not flat" in words for words in found.warnings)
    assert any("left edge" in words and "uncertain by up to" in words for words in found.warnings)


def test_sony5n_and_what_is_wrong_with_it():
    folder = PHOTOS / "sony5n"
    found = calibrate_files([folder], Board(cols=7, rows=6, square_m=0.1))
    published = read_camera(folder / "sony5n_1920x1080.json")
    assert len(found.views) == 28
    assert found.rms_px <= 1.2
    assert found.camera.K[0, 0] == pytest.approx(published.K[0, 0], rel=0.005)
    assert found.camera.K[1, 1] == pytest.approx(published.K[1, 1], rel=0.005)
    assert found.verdict == "poor"
    words = " ".join(found.warnings)
    assert "rolling shutter" in words
    assert "blurred in one direction" in words
    assert "00052.jpg" in words


def test_every_real_camera_file_reads():
    files = sorted(REAL.glob("multicam/*/cam*.json"))
    assert len(files) >= 8
    assert all(read_camera(f).image_size[1] == 1080 for f in files)
