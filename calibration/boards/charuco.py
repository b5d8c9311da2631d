"""The ChArUco pattern of a board: a checkerboard whose white squares hold markers."""

from __future__ import annotations

import cv2

from calibration.boards.board import Board
from calibration.foundation.errors import UsageError


def _larger(name: str, needed: int) -> str:
    """Names a dictionary of the same kind of markers that holds as many as are needed."""
    kind = name.rpartition("_")[0]
    sizes = [n for n in (50, 100, 250, 1000) if n >= needed and hasattr(cv2.aruco, f"{kind}_{n}")]
    return f"--dictionary {kind}_{sizes[0]}, or a smaller board" if sizes else "print a board of fewer squares"


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
    needed, held = (board.cols + 1) * (board.rows + 1) // 2, len(dictionary.bytesList)
    if needed > held:
        raise UsageError(
            where="marker dictionary",
            seen=f"{board.dictionary}, which holds {held} markers",
            expected=f"the {needed} markers of a board of {board.name} inner corners",
            advice=_larger(board.dictionary, needed),
        )
    made = cv2.aruco.CharucoBoard((board.cols + 1, board.rows + 1), board.square_m, board.marker_m, dictionary)
    if legacy:
        made.setLegacyPattern(True)
    return made
