"""The pattern of a ChArUco board, and dictionaries that are too small for it."""

import pytest

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.foundation.errors import UsageError


def board(cols: int, rows: int, dictionary: str) -> Board:
    return Board(cols=cols, rows=rows, square_m=0.025, marker_m=0.018, dictionary=dictionary)


def test_a_dictionary_that_is_too_small_names_one_that_is_not():
    with pytest.raises(UsageError, match=r"holds 50 markers; expected the 54 markers of a board of 11x8.*DICT_4X4_100"):
        charuco_board(board(11, 8, "DICT_4X4_50"))
    with pytest.raises(UsageError, match="fewer squares"):
        charuco_board(board(50, 50, "DICT_5X5_1000"))


def test_a_dictionary_that_is_just_large_enough_will_do():
    assert len(charuco_board(board(9, 9, "DICT_4X4_50")).getIds()) == 50
