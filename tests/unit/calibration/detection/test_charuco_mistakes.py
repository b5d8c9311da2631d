"""A ChArUco board that is not the one described: the photos say what it is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.detection.charuco_mistakes import why_not_found, wrong_marker

BOARD = Board(cols=6, rows=4, square_m=0.03, marker_m=0.021, dictionary="DICT_5X5_100")


def photo(board, **looks):
    sheet = np.asarray(charuco_board(board).generateImage(((board.cols + 1) * 70, (board.rows + 1) * 70), marginSize=0))
    framed = cv2.copyMakeBorder(sheet, 50, 50, 50, 50, cv2.BORDER_CONSTANT, value=255)
    shot = cv2.GaussianBlur(framed, (0, 0), 0.8)
    return 255 - shot if looks.get("inverted") else shot


@pytest.mark.parametrize(
    ("true", "looks", "where", "advice"),
    [
        (BOARD, {"inverted": True}, "photos", "black and white exchanged"),
        (replace(BOARD, cols=4, rows=6), {}, "--board", "--board 4x6"),
        (replace(BOARD, dictionary="DICT_4X4_50"), {}, "--dictionary", "--dictionary DICT_4X4_50"),
        (replace(BOARD, dictionary="DICT_APRILTAG_36H11"), {}, "--dictionary", "DICT_APRILTAG_36"),
    ],
)
def test_a_board_that_is_not_found_says_why(true, looks, where, advice):
    found = why_not_found([photo(true, **looks)], BOARD)
    assert found is not None
    assert found.where == where
    assert advice.lower() in found.advice.lower()


def test_a_photo_without_a_board_says_nothing():
    sky = np.tile(np.linspace(60, 200, 320).astype(np.uint8), (240, 1))
    assert why_not_found([sky], BOARD) is None


def test_markers_of_another_size_are_measured():
    shots = [photo(BOARD)]
    assert wrong_marker(shots, BOARD) is None
    found = wrong_marker(shots, replace(BOARD, marker_m=0.024))
    assert found is not None
    assert "24 mm beside squares of 30 mm" in found.seen
    assert abs(float(found.advice.split("--marker-mm ")[1].split()[0]) - 21) < 0.6
