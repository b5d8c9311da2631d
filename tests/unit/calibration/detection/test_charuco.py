"""ChArUco corners: as exact as a checkerboard's, on tilted and on partial boards."""

import cv2
import numpy as np
import pytest

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.detection.charuco import _squeezed, _unrefined
from calibration.detection.find import find_board

BOARD = Board(cols=9, rows=6, square_m=0.025, marker_m=0.018, dictionary="DICT_5X5_100")
PER, MARGIN = 80, 80


def shot(place, plain=False, seed=0):
    """A board seen through the homography `place` (sheet pixels to image pixels), and its corners (54, 2)."""
    size = ((BOARD.cols + 1) * PER, (BOARD.rows + 1) * PER)
    sheet = np.asarray(charuco_board(BOARD).generateImage(size, marginSize=0))
    if plain:
        y, x = np.mgrid[: BOARD.rows + 1, : BOARD.cols + 1]
        sheet = np.kron(((x + y) % 2 * 255).astype(np.uint8), np.ones((PER, PER), np.uint8))
    sheet = cv2.copyMakeBorder(sheet, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_CONSTANT, value=255)
    fine = np.array([[3, 0, 1], [0, 3, 1], [0, 0, 1]]) @ place
    large = cv2.warpPerspective(sheet, fine, (2400, 1800), flags=cv2.INTER_LINEAR, borderValue=160)
    small = cv2.GaussianBlur(cv2.resize(large, (800, 600), interpolation=cv2.INTER_AREA).astype(float), (0, 0), 0.7)
    noisy = 0.75 * small + 25 + np.random.default_rng(seed).normal(0, 2.0, small.shape)
    corners = BOARD.points_m[None, :, :2] / BOARD.square_m * PER + PER + MARGIN - 0.5
    return np.clip(noisy, 0, 255).astype(np.uint8), cv2.perspectiveTransform(corners, place)[0]


STRAIGHT = np.array([[0.6, 0.05, 60], [-0.04, 0.62, 90], [0, 0, 1.0]])
TILTED = np.array([[0.62, 0.2, 40], [0.02, 0.5, 120], [5e-4, 3e-4, 1.0]])
PARTLY = np.array([[0.9, 0.25, -220], [0.02, 0.8, 60], [2e-4, 4e-4, 1.0]])


def off(found, true):
    return np.linalg.norm(found.corners - true[found.index], axis=1)


@pytest.mark.parametrize("place", [STRAIGHT, TILTED, PARTLY], ids=["straight", "tilted", "partly"])
def test_corners_are_no_worse_than_opencvs_and_as_good_as_a_checkerboards(place):
    image, true = shot(place)
    found = find_board(image, BOARD, "x")
    theirs, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(BOARD)).detectBoard(image)
    error = np.linalg.norm(np.reshape(theirs, (-1, 2)) - true[np.ravel(ids)], axis=1)
    assert len(found.index) >= 0.95 * len(ids)
    assert off(found, true).max() <= max(error.max(), 0.1)
    assert np.sqrt(np.mean(off(found, true) ** 2)) < 0.5 * np.sqrt(np.mean(error**2))
    plain, _ = shot(place, plain=True)
    board = Board(cols=9, rows=6, square_m=0.025)
    checker = find_board(plain, board, "x")
    if checker is not None and len(checker.index) == 54:
        both = (off(checker, true), off(checker, true[::-1]))
        assert np.sqrt(np.mean(off(found, true) ** 2)) < 1.5 * min(np.sqrt(np.mean(e**2)) for e in both) + 0.004


STEEP = np.array([[0.6, 0.02, 80], [0.02, 0.14, 200], [1e-4, 5e-5, 1.0]])


def test_a_board_so_steep_that_markers_touch_its_edges_gives_no_corners_that_are_noise():
    image, true = shot(STEEP)
    found = find_board(image, BOARD, "x")
    assert found is None or off(found, true).max() < 0.1


def test_corners_that_stayed_where_opencv_found_them_are_left_out_where_most_moved():
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1) * 30
    seen, fine = np.ones((3, 4), bool), grid + 0.02
    fine[1, 2] = grid[1, 2]
    assert np.argwhere(_unrefined(fine, grid, seen)).tolist() == [[1, 2]]
    assert not _unrefined(grid, grid, seen).any()


def test_only_steep_boards_are_squeezed():
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=-1)
    assert not _squeezed(grid * 14, 0.14).any()
    assert _squeezed(grid * [37, 14], 0.14).all()
    assert not _squeezed(grid * [80, 30], 0.14).any()
