"""Finding the board in a photo: coarsely on a reduced image, then every corner on the full one.

The coarse search (`findChessboardCorners` on an image at most 640 pixels wide) costs milliseconds and is right to
about a pixel of the reduced image; the refinement (`cornerSubPix`, window growing with the corner spacing) decides
the accuracy: about 0.02 px. Where the coarse search fails, larger images and the sector-based detector are tried.
Corners that the image does not show (a finger, a glare) are dropped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

import cv2
import numpy as np

from calibration.arrays import Floats
from calibration.board import Board
from calibration.charuco import find_charuco
from calibration.squares import edge_blur_px, seen_corners, spacing_px
from calibration.views import BoardView

COARSE_PX = (640, 1280)
SECTOR_PX = 1280
MIN_SEEN = 0.7
REFINE_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 5e-4)


def find_board(
    gray: cv2.typing.MatLike, board: Board, name: str, *, taken: Mapping[str, str] | None = None
) -> BoardView | None:
    """The board in `gray` (uint8), or None where it is not there or mostly hidden."""
    if board.marker_m is not None:
        return find_charuco(gray, board, name, taken=taken)
    coarse = coarse_grid(gray, board)
    if coarse is None:
        return None
    grid = refine(gray, coarse)
    seen = seen_corners(gray, grid) & (np.linalg.norm(grid - coarse, axis=2) < 0.3 * spacing_px(coarse))
    if seen.mean() < MIN_SEEN:
        return None
    return BoardView(
        name=name,
        image_size=(gray.shape[1], gray.shape[0]),
        corners=grid[seen],
        index=np.flatnonzero(seen.ravel()),
        blur_px=edge_blur_px(gray, grid),
        taken=taken or {},
    )


def coarse_grid(gray: cv2.typing.MatLike, board: Board) -> Floats | None:
    """Corners (rows, cols, 2) to about a pixel of the reduced image, or None."""
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    size = (board.cols, board.rows)
    for step, longest in enumerate(COARSE_PX):
        if step and max(gray.shape) <= COARSE_PX[step - 1]:
            break
        small, scale = reduced(gray, longest)
        found, corners = cv2.findChessboardCorners(small, size, flags=flags)
        if found:
            return _full_size(corners, scale, board)
    small, scale = reduced(gray, SECTOR_PX)
    found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return _full_size(corners, scale, board) if found else None


def refine(gray: cv2.typing.MatLike, grid: Floats) -> Floats:
    """Corners (rows, cols, 2) to a few hundredths of a pixel.

    The image is smoothed a little first: the gradients that `cornerSubPix` squares are what noise biases.
    """
    spacing = spacing_px(grid)
    half = int(np.clip(spacing / 3, 3, max(15, spacing / 5)))
    margin = half + 8
    left, top = np.maximum(np.floor(grid.min(axis=(0, 1))).astype(int) - margin, 0)
    right, bottom = np.ceil(grid.max(axis=(0, 1))).astype(int) + margin
    smooth = cv2.GaussianBlur(gray[top:bottom, left:right], (0, 0), min(1.5, spacing / 12))
    origin = np.array([left, top], float)
    start = (grid - origin).reshape(-1, 1, 2).astype(np.float32)
    fine = cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), REFINE_STOP)
    return np.asarray(np.asarray(fine, float).reshape(grid.shape) + origin)


def reduced(gray: cv2.typing.MatLike, longest: int) -> tuple[cv2.typing.MatLike, float]:
    """The image with its longer side at most `longest`, and the scale from full to reduced."""
    scale = longest / max(gray.shape)
    if scale >= 1:
        return gray, 1.0
    return cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), scale


def looks_like(photos: Iterable[cv2.typing.MatLike]) -> tuple[tuple[int, int], int, int] | None:
    """((cols, rows), votes, photos asked): inner corners, longer side first, that most of the photos seem to show."""
    sizes: Counter[tuple[int, int]] = Counter()
    asked = 0
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    for gray in photos:
        asked += 1
        for start in ((4, 4), (3, 3)):
            found, _, meta = cv2.findChessboardCornersSBWithMeta(reduced(gray, 800)[0], start, flags)
            if found:
                sizes[max(meta.shape[:2]), min(meta.shape[:2])] += 1
                break
    if not sizes:
        return None
    best, votes = sizes.most_common(1)[0]
    return best, votes, asked


def _full_size(corners: cv2.typing.MatLike, scale: float, board: Board) -> Floats:
    """Corners of a reduced image in pixels of the full one: pixel centres are whole numbers in both."""
    full = (np.asarray(corners, float).reshape(board.rows, board.cols, 2) + 0.5) / scale - 0.5
    return np.asarray(full)
