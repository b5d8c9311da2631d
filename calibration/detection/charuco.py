"""ChArUco boards: a checkerboard whose white squares hold markers, so that part of it is enough."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.boards.view import BoardView
from calibration.detection.squares import edge_blur_px
from calibration.foundation.arrays import Floats

LEAST_CORNERS = 8
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)


def find_charuco(
    gray: cv2.typing.MatLike, board: Board, name: str, *, taken: Mapping[str, str] | None = None
) -> BoardView | None:
    """The part of a ChArUco board that `gray` shows, or None where that is less than 8 corners or all in a line."""
    for legacy in (False, True):
        detector = cv2.aruco.CharucoDetector(charuco_board(board, legacy=legacy))
        corners, ids, _, _ = detector.detectBoard(gray)
        if ids is not None and len(ids) >= LEAST_CORNERS:
            return _view(gray, board, np.asarray(corners, float).reshape(-1, 2), np.ravel(ids), name, taken or {})
    return None


def _view(
    gray: cv2.typing.MatLike,
    board: Board,
    corners: Floats,
    ids: np.typing.NDArray[np.int64],
    name: str,
    taken: Mapping[str, str],
) -> BoardView | None:
    flat, _ = cv2.findHomography(board.points_m[ids, :2], corners, cv2.RANSAC, 3.0)
    if flat is None or np.linalg.matrix_rank(board.points_m[ids, :2] - board.points_m[ids[0], :2]) < 2:
        return None
    grid = cv2.perspectiveTransform(board.points_m[None, :, :2], flat).reshape(board.rows, board.cols, 2)
    fine = _refined(gray, board, corners, ids, grid)
    order = np.argsort(ids)
    return BoardView(
        name=name,
        image_size=(gray.shape[1], gray.shape[0]),
        corners=fine[order],
        index=ids[order],
        blur_px=edge_blur_px(gray, np.asarray(grid, float)),
        taken=taken,
    )


def _refined(
    gray: cv2.typing.MatLike, board: Board, corners: Floats, ids: np.typing.NDArray[np.int64], grid: cv2.typing.MatLike
) -> Floats:
    """Sub-pixel corners; the window stays clear of the markers."""
    assert board.marker_m is not None
    place = np.asarray(grid, float)
    steps = np.minimum(
        np.linalg.norm(np.gradient(place, axis=1), axis=2), np.linalg.norm(np.gradient(place, axis=0), axis=2)
    )
    spacing = float(np.median(steps.ravel()[ids]))
    clear = spacing * (1 - board.marker_m / board.square_m) / 2
    half = int(np.clip(0.9 * clear, 2, 11))
    smooth = cv2.GaussianBlur(gray, (0, 0), float(np.clip(spacing / 40, 0.5, 1.2)))
    start = corners.reshape(-1, 1, 2).astype(np.float32)
    fine = np.asarray(cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), STOP), float).reshape(-1, 2)
    jumped = np.linalg.norm(fine - corners, axis=1) > max(2.0, half)
    return np.where(jumped[:, None], corners, fine)
