"""ChArUco boards: a checkerboard whose white squares hold markers, so that part of it is enough."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.boards.view import BoardView
from calibration.detection.squares import PROFILE_REACH, edge_blur_px, in_line, laid_in
from calibration.detection.subpixel import LEAST_BLUR_PX, sharpened
from calibration.foundation.arrays import Bools, Floats, Ints

LEAST_CORNERS, LEAST_SIDE = 8, 3
"""Corners that make a view; rows and columns from which edges are bent as the lens bends them."""
WINDOW_SHARE, LEAST_WINDOW_PX, MOST_WINDOW_PX = 0.9, 2, 11
"""Half a corner's window over the way to the nearest marker. Above 1 the marker pulls the corner."""
EDGE_SHARE = 0.8
"""Across an edge, of the way to the marker: the marker's own blur begins there."""
FINE_STEPS = 2
"""Steps along the edges: the strips are narrow, so that one may not reach."""
MOST_MOVED, MOST_MOVED_PX = 0.5, 1.5
"""Of the way to the marker, but pixels at least: a corner that wants further is left where OpenCV found it."""
SQUEEZED, LEAST_STRIP_PX = 0.5, 2.2
"""Corners of steeply tilted boards (one spacing over the other below the first) whose strip between edge and marker is
narrower than this are left out: what is left of the edge is mostly noise (0.1 px where others have 0.007)."""
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
    ids: Ints,
    name: str,
    taken: Mapping[str, str],
) -> BoardView | None:
    flat, _ = cv2.findHomography(board.points_m[ids, :2], corners, cv2.RANSAC, 3.0)
    if flat is None or np.linalg.matrix_rank(board.points_m[ids, :2] - board.points_m[ids[0], :2]) < 2:
        return None
    order = np.argsort(ids)
    ids, corners = ids[order], corners[order]
    grid, seen = _part(board, corners, ids, np.asarray(flat, float))
    clear = (1 - (board.marker_m or 0) / board.square_m) / 2
    fine = _windowed(gray, grid, seen, clear)
    blur = edge_blur_px(gray, fine, reach=min(PROFILE_REACH, EDGE_SHARE * clear))
    if min(grid.shape[:2]) >= LEAST_SIDE:
        fine = _along_edges(gray, fine, seen, clear, blur)
    far = np.linalg.norm(fine - grid, axis=2) > np.maximum(MOST_MOVED_PX, MOST_MOVED * clear * _spacing(grid))
    fine = np.where(far[..., None], grid, fine)
    weak = _squeezed(grid, clear) | _unrefined(fine, grid, seen)
    good = in_line(fine)[seen] if min(grid.shape[:2]) >= LEAST_SIDE else np.ones(len(ids), bool)
    good = good & ~weak[seen]
    if good.sum() < LEAST_CORNERS:
        return None
    return BoardView(
        name=name,
        image_size=(gray.shape[1], gray.shape[0]),
        corners=fine[seen][good],
        index=ids[good],
        blur_px=blur,
        taken=taken,
    )


def _part(board: Board, corners: Floats, ids: Ints, flat: Floats) -> tuple[Floats, Bools]:
    """The rows and columns that hold what was seen: grid (rows, cols, 2), and which of it was seen.

    What was not seen is laid in by a smooth surface through the rest.
    """
    row, col = ids // board.cols, ids % board.cols
    part = np.s_[row.min() : row.max() + 1, col.min() : col.max() + 1]
    whole, seen = np.full((board.rows, board.cols, 2), np.nan), np.zeros((board.rows, board.cols), bool)
    whole[row, col], seen[row, col] = corners, True
    plane = board.points_m[:, :2].reshape(board.rows, board.cols, 2)[part].reshape(1, -1, 2)
    guess = np.asarray(cv2.perspectiveTransform(plane, flat), float).reshape(whole[part].shape)
    grid = np.where(seen[part][..., None], whole[part], guess)
    if min(grid.shape[:2]) >= LEAST_SIDE and not seen[part].all():
        grid = laid_in(grid, seen[part])
    edge = 4 * max(float(np.abs(corners).max()), 1.0)
    return np.asarray(np.clip(grid, -edge, edge)), seen[part]


def _spacing(grid: Floats) -> Floats:
    """(rows, cols) distance to the nearest neighbour in the grid; 1 px at least."""
    near = np.full(grid.shape[:2], np.inf)
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    near[:, 1:], near[:, :-1] = np.minimum(near[:, 1:], across), np.minimum(near[:, :-1], across)
    near[1:], near[:-1] = np.minimum(near[1:], down), np.minimum(near[:-1], down)
    return np.asarray(np.maximum(near, 1.0))


def _squeezed(grid: Floats, clear: float) -> Bools:
    """(rows, cols) corners of a board so steep that hardly a strip is left between their edges and the markers."""
    across, down = np.full(grid.shape[:2], np.nan), np.full(grid.shape[:2], np.nan)
    if grid.shape[1] > 1:
        step = np.linalg.norm(np.diff(grid, axis=1), axis=2)
        across = np.concatenate([step, step[:, -1:]], axis=1)
    if grid.shape[0] > 1:
        step = np.linalg.norm(np.diff(grid, axis=0), axis=2)
        down = np.concatenate([step, step[-1:]], axis=0)
    near = _spacing(grid)
    steep = near < SQUEEZED * np.fmax(across, down)
    return np.asarray(steep & (EDGE_SHARE * clear * near < LEAST_STRIP_PX))


def _unrefined(fine: Floats, grid: Floats, seen: Bools) -> Bools:
    """(rows, cols) corners that stayed where OpenCV found them, where most others of the photo did not."""
    stayed = np.all(fine == grid, axis=2)
    return np.asarray(stayed & (2 * stayed[seen].sum() < seen.sum()))


def _windowed(gray: cv2.typing.MatLike, grid: Floats, seen: Bools, clear: float) -> Floats:
    """Corners by `cornerSubPix`, each in a window of its own that stays clear of the markers beside it."""
    half = np.clip(WINDOW_SHARE * clear * _spacing(grid), LEAST_WINDOW_PX, MOST_WINDOW_PX).astype(int)
    fine = grid.copy()
    for size in np.unique(half[seen]):
        here = seen & (half == size)
        start = grid[here].reshape(-1, 1, 2).astype(np.float32)
        found = cv2.cornerSubPix(gray, start, (int(size), int(size)), (-1, -1), STOP)
        fine[here] = np.asarray(found, float).reshape(-1, 2)
    jumped = np.linalg.norm(fine - grid, axis=2) > np.maximum(1.0, half)
    return np.asarray(np.where(jumped[..., None], grid, fine))


def _along_edges(
    gray: cv2.typing.MatLike, grid: Floats, seen: Bools, clear: float, blur_px: tuple[float, float]
) -> Floats:
    """Corners by their edges (subpixel.py), sampled between the corner and the markers."""
    usual = float(np.hypot(*blur_px) / np.sqrt(2))
    usual = max(LEAST_BLUR_PX, usual) if usual == usual else 1.0
    near = sharpened(gray, grid, 1.5 * usual, straight=True, clear=EDGE_SHARE * clear).grid
    for _ in range(FINE_STEPS):
        near = np.where(seen[..., None], near, grid)
        near = sharpened(gray, near, usual, clear=EDGE_SHARE * clear).grid
    return np.asarray(np.where(seen[..., None], near, grid))
