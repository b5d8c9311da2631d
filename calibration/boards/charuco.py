"""The ChArUco pattern of a board: a checkerboard whose white squares hold markers."""

from __future__ import annotations

import cv2

from calibration.boards.board import Board
from calibration.foundation.errors import UsageError


def charuco_board(board: Board, *, legacy: bool = False) -> cv2.aruco.CharucoBoard:
    """OpenCV's board; `legacy` is the pattern of OpenCV before 4.6. Raises UsageError for an unknown dictionary."""
    assert board.marker_m is not None
    known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if board.dictionary not in known:
        raise UsageError(
            where="marker dictionary",
            seen=repr(board.dictionary),
            expected=f"a dictionary of OpenCV, such as {', '.join(known[:5])}",
            advice="look up the name the board was printed with",
        )
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    made = cv2.aruco.CharucoBoard((board.cols + 1, board.rows + 1), board.square_m, board.marker_m, dictionary)
    if legacy:
        made.setLegacyPattern(True)
    return made
