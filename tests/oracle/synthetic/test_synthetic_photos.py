"""Board photos against OpenCV: corners are where the lens puts them, and its calibration finds the lens again."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.camera import project
from pipeline.synthetic.board_photos import PrintedBoard, board_poses, photos
from pipeline.synthetic.demo_scenes import small_scene

BOARD = PrintedBoard()
LENS = small_scene().cameras[0].lens


@pytest.fixture(scope="module")
def corners():
    """Found and true corners of each of 20 photos, after JPEG."""
    pairs = []
    poses = board_poses(LENS, BOARD, count=20, seed=3)
    for photo, pose in zip(photos(LENS, BOARD, count=20, seed=3), poses, strict=True):
        grey = cv2.imdecode(cv2.imencode(".jpg", photo, [cv2.IMWRITE_JPEG_QUALITY, 92])[1], cv2.IMREAD_GRAYSCALE)
        ok, found = cv2.findChessboardCorners(grey, (BOARD.columns, BOARD.rows))
        assert ok
        found = cv2.cornerSubPix(grey, found, (4, 4), (-1, -1), (3, 60, 1e-4)).reshape(-1, 2)
        true = project(LENS, BOARD.inner_corners() @ pose.cam_from_board.T + pose.place_cam_m)
        back = np.abs(found - true).mean() > np.abs(found[::-1] - true).mean()
        pairs.append((found[::-1] if back else found, true))
    return pairs


def test_corners_are_found_where_they_are(corners):
    error = np.concatenate([found - true for found, true in corners])
    assert np.sqrt((error**2).mean()) < 0.05
    assert np.abs(error.mean(axis=0)).max() < 0.006


def test_opencv_finds_the_lens_again(corners):
    board = BOARD.inner_corners().astype(np.float32)
    views = [found.astype(np.float32) for found, _ in corners]
    rms, K, _, _, _ = cv2.calibrateCamera([board] * len(views), views, LENS.image_size, None, None)
    assert rms < 0.08
    assert K[0, 0] == pytest.approx(LENS.K[0, 0], rel=0.002)
    assert K[1, 1] == pytest.approx(LENS.K[1, 1], rel=0.002)
    assert K[:2, 2] == pytest.approx(LENS.K[:2, 2], abs=1.5)


def test_the_views_differ_and_cover_the_image(corners):
    everywhere = np.concatenate([found for found, _ in corners])
    width, height = LENS.image_size
    assert everywhere.min(axis=0) == pytest.approx([0, 0], abs=0.12 * width)
    assert everywhere.max(axis=0) == pytest.approx([width, height], abs=0.12 * width)
    tilt = [np.degrees(np.arccos(p.cam_from_board[2, 2])) for p in board_poses(LENS, BOARD, count=20, seed=3)]
    assert min(tilt) > 10
    assert np.ptp(tilt) > 15


def test_same_seed_same_pixels():
    one, two, other = (next(photos(LENS, BOARD, count=2, seed=s)) for s in (5, 5, 6))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)
