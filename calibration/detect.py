"""Finding the board in a photo: coarsely on a reduced image, then every corner on the full one.

The coarse search (`findChessboardCorners` on an image a few hundred pixels wide) costs milliseconds and is right to
about a pixel of the reduced image; the refinement (`cornerSubPix`, window growing with the corner spacing) decides
the accuracy: about 0.02 px. Where the coarse search fails, larger images and the sector-based detector are tried.
Corners that the image does not show (a finger, a glare) are dropped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

import cv2
import numpy as np

from calibration.arrays import Floats
from calibration.board import Board
from calibration.charuco import find_charuco
from calibration.squares import edge_blur_px, seen_corners, spacing_px
from calibration.views import BoardView

USUAL = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
COARSE = ((640, cv2.CALIB_CB_ADAPTIVE_THRESH), (640, USUAL), (1280, USUAL))
"""Longer sides of the reduced images that are searched in turn, and how: the first one finds most boards."""

SECTOR_PX = 1280
MIN_SEEN = 0.7
REFINE_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-3)


def find_board(
    gray: cv2.typing.MatLike, board: Board, name: str, *, taken: Mapping[str, str] | None = None
) -> BoardView | None:
    """The board in `gray` (uint8), or None where it is not there or mostly hidden."""
    if board.marker_m is not None:
        return find_charuco(gray, board, name, taken=taken)
    best, most = None, 0
    for coarse in coarse_grids(gray, board):
        grid = refine(gray, coarse)
        moved = np.hypot(*(grid - coarse).transpose(2, 0, 1))
        seen = seen_corners(gray, grid) & (moved < 0.3 * spacing_px(coarse))
        if seen.sum() > most:
            best, most = (grid, seen), int(seen.sum())
        if most == seen.size:
            break
    if best is None or most < MIN_SEEN * best[1].size:
        return None
    grid, seen = best
    return BoardView(
        name=name,
        image_size=(gray.shape[1], gray.shape[0]),
        corners=grid[seen],
        index=np.flatnonzero(seen.ravel()),
        blur_px=edge_blur_px(gray, grid),
        taken=taken or {},
    )


def coarse_grids(gray: cv2.typing.MatLike, board: Board) -> Iterator[Floats]:
    """Corners (rows, cols, 2) to about a pixel of a reduced image, from one reduction after the other."""
    size, tried, any_found = (board.cols, board.rows), set(), False
    for longest, flags in COARSE:
        small, factor = reduced(gray, longest)
        if (factor, flags) in tried:
            continue
        tried.add((factor, flags))
        found, corners = cv2.findChessboardCorners(small, size, flags=flags)
        if found:
            any_found = True
            yield _full_size(corners, factor, board)
    if not any_found:
        small, factor = reduced(gray, SECTOR_PX)
        found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if found:
            yield _full_size(corners, factor, board)


def refine(gray: cv2.typing.MatLike, grid: Floats) -> Floats:
    """Corners (rows, cols, 2) to a few hundredths of a pixel.

    The image is smoothed a little first: the gradients that `cornerSubPix` squares are what noise biases. A window
    of a third of the spacing it is: 0.42 is better on rendered photos, but leaves 0.16 instead of 0.10 px on real ones.
    """
    spacing = spacing_px(grid)
    half = int(np.clip(spacing / 3, 3, max(15, spacing / 5)))
    margin = half + 8
    left, top = np.maximum(np.floor(grid.min(axis=(0, 1))).astype(int) - margin, 0)
    right, bottom = np.ceil(grid.max(axis=(0, 1))).astype(int) + margin
    part, sigma = gray[top:bottom, left:right], min(2.0, spacing / 12)
    smooth = cv2.GaussianBlur(part, (5, 5) if sigma > 1 else (3, 3), sigma)
    origin = np.array([left, top], float)
    start = (grid - origin).reshape(-1, 1, 2).astype(np.float32)
    fine = cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), REFINE_STOP)
    return np.asarray(np.asarray(fine, float).reshape(grid.shape) + origin)


def reduced(gray: cv2.typing.MatLike, longest: int) -> tuple[cv2.typing.MatLike, int]:
    """The image reduced until its longer side is at most `longest`, and the factor: a power of two.

    Those are fifty times quicker to average over; up to factor - 1 pixels at the right and lower edge are lost.
    """
    factor = 1
    while max(gray.shape) > longest * factor:
        factor *= 2
    if factor == 1:
        return gray, 1
    height, width = gray.shape[0] // factor, gray.shape[1] // factor
    part = gray[: height * factor, : width * factor]
    return cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA), factor


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


def _full_size(corners: cv2.typing.MatLike, factor: int, board: Board) -> Floats:
    """Corners of a reduced image in pixels of the full one: pixel centres are whole numbers in both."""
    full = (np.asarray(corners, float).reshape(board.rows, board.cols, 2) + 0.5) * factor - 0.5
    return np.asarray(full)
