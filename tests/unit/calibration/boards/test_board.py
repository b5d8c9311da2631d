import numpy as np
import pytest

from calibration import Board
from calibration.foundation.errors import UsageError


def test_parse_counts_inner_corners_row_by_row():
    board = Board.parse(" 9x6 ", square_mm=25)
    assert (board.cols, board.rows, board.name) == (9, 6, "9x6")
    assert board.points_m.shape == (54, 3)
    np.testing.assert_allclose(board.points_m[10], (0.025, 0.025, 0))


@pytest.mark.parametrize("text", ["9", "9x", "axb", "9x6x2", "-9x6", ""])
def test_text_that_is_no_board_says_how_to_count(text):
    with pytest.raises(UsageError, match="9x6") as error:
        Board.parse(text, square_mm=25)
    assert error.value.exit_code == 2


@pytest.mark.parametrize(("cols", "square"), [(2, 25.0), (9, 0.0), (9, -1.0), (9, float("nan"))])
def test_impossible_boards_are_refused(cols, square):
    with pytest.raises(UsageError):
        Board.parse(f"{cols}x6", square_mm=square)


def test_a_marker_must_fit_into_its_square():
    with pytest.raises(UsageError, match="marker"):
        Board.parse("9x6", square_mm=25, marker_mm=25)
