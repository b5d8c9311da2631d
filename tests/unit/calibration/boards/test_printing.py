import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from calibration.boards.board import Board
from calibration.boards.printing import board_page, board_pdf, board_svg, paper_in_words, papers
from calibration.detection.find import find_board

PLAIN = Board(cols=9, rows=6, square_m=0.020)
CHARUCO = Board(cols=7, rows=5, square_m=0.030, marker_m=0.022, dictionary="DICT_4X4_50")


def drawn(board, pixels_per_mm=4):
    """The page as a printer would make it."""
    width, height, _, shapes = board_page(board)
    page = np.full((round(height * pixels_per_mm), round(width * pixels_per_mm)), 255, np.uint8)
    for x, y, w, h in shapes:
        left, top, right, bottom = (round(v * pixels_per_mm) for v in (x, y, x + w, y + h))
        page[top:bottom, left:right] = 0
    return cv2.GaussianBlur(page, (0, 0), 1.0)


@pytest.mark.parametrize("board", [PLAIN, CHARUCO])
def test_the_printed_board_is_the_board_that_is_found(board):
    view = find_board(drawn(board), board, "page")
    margin = board_page(board)[2]
    true = (board.points_m[:, :2] * 1000 + board.square_m * 1000 + margin) * 4 - 0.5
    assert len(view.index) == board.cols * board.rows
    off = min((view.corners - t for t in (true, true[::-1])), key=lambda e: float(np.abs(e).max()))
    assert np.abs(off).max() < 0.15


@pytest.mark.parametrize(
    ("board", "smallest", "words"),
    [
        (PLAIN, "A4", "prints on A4 or larger"),
        (Board(cols=9, rows=6, square_m=0.025), "A4", "prints on A4 or larger"),
        (Board(cols=9, rows=6, square_m=0.030), "A3", "does not fit A4 (210 x 297 mm) or US Letter; it needs A3"),
        (Board(cols=11, rows=8, square_m=0.060), "A1", "squares of 20 mm would print on A4"),
        (Board(cols=13, rows=9, square_m=0.120), "", "no paper up to A0"),
    ],
)
def test_a_board_that_does_not_fit_a_page_is_said_with_page_sizes(board, smallest, words):
    assert (papers(board) or ("",))[0] == smallest
    assert words in paper_in_words(board)


def test_svg_is_at_true_scale():
    root = ET.fromstring(board_svg(PLAIN))
    assert (root.get("width"), root.get("height")) == ("240mm", "180mm")
    assert "9x6 inner corners, square 20 mm" in board_svg(PLAIN)


def test_pdf_page_and_its_table_of_contents():
    raw = board_pdf(CHARUCO)
    box = re.search(rb"MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", raw)
    assert float(box[1]) == pytest.approx((8 * 30 + 60) * 72 / 25.4, abs=0.01)
    start = int(re.search(rb"startxref\n(\d+)", raw)[1])
    assert raw[start : start + 4] == b"xref"
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", raw), 1):
        assert raw[int(place) :].startswith(b"%d 0 obj" % number)
