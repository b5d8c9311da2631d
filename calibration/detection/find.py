"""Finding the board in a photo: coarsely on a reduced image, then every corner on the full one.

The coarse search (`findChessboardCorners` on an image a few hundred pixels wide) costs milliseconds and is right to
about a pixel of the reduced image; the refinement (subpixel.py) decides the accuracy: about 0.01 px. Where the coarse
search fails, larger images and the sector-based detector are tried.
Corners that the image does not show (a finger, a glare) are dropped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.boards.view import BoardView
from calibration.detection.charuco import find_charuco
from calibration.detection.squares import in_line, laid_in, spacing_px
from calibration.detection.subpixel import refined
from calibration.foundation.arrays import Bools, Floats

USUAL = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
COARSE = (
    (640, cv2.CALIB_CB_PLAIN),
    (640, cv2.CALIB_CB_NORMALIZE_IMAGE),
    (640, cv2.CALIB_CB_ADAPTIVE_THRESH),
    (640, USUAL),
    (1280, USUAL),
)
"""Longer sides of the reduced images that are searched in turn, and how.

One threshold for the whole image (Otsu's, then the one OpenCV derives) takes a third to a half of the time of adaptive
ones and finds boards that are evenly lit.
"""

STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.1)
SECTOR_PX = 1280
MIN_SEEN = 0.7
OFF_PX = 0.7
"""How far a coarse corner may be off, in pixels of the reduced image."""


def find_board(
    gray: cv2.typing.MatLike, board: Board, name: str, *, taken: Mapping[str, str] | None = None
) -> BoardView | None:
    """The board in `gray` (uint8), or None where it is not there or mostly hidden."""
    if board.marker_m is not None:
        return find_charuco(gray, board, name, taken=taken)
    best, most = None, 0
    for coarse, factor in coarse_grids(gray, board):
        found = _verified(gray, coarse, factor)
        if int(found[1].sum()) > most:
            best, most = found, int(found[1].sum())
        if most == board.cols * board.rows:
            break
    if best is None or most < MIN_SEEN * board.cols * board.rows:
        return None
    grid, seen, blur_px = best
    return BoardView(
        name=name,
        image_size=(gray.shape[1], gray.shape[0]),
        corners=grid[seen],
        index=np.flatnonzero(seen.ravel()),
        blur_px=blur_px,
        taken=taken or {},
    )


def _verified(gray: cv2.typing.MatLike, coarse: Floats, factor: int) -> tuple[Floats, Bools, tuple[float, float]]:
    """Refined corners (rows, cols, 2), which of them the image shows, and the edges' blur.

    Where every corner alternates with its neighbours, has whole edges and hardly moved, there is no doubt. Else corners
    must lie on one surface too, and what is hidden is laid in anew and the others refined again beside it.
    Turned by 180 degrees a board with an odd and an even side is another pattern: it is counted from the dark square.
    """
    found = refined(gray, coarse, OFF_PX * factor)
    if sum(coarse.shape[:2]) % 2 == 1 and not found.dark_first and found.seen.any():
        return _verified(gray, coarse[::-1, ::-1], factor)
    far = np.abs(found.grid - coarse).max(axis=2)
    if (found.seen & found.whole).all() and far.max() < OFF_PX * factor:
        return found.grid, found.seen, found.blur_px
    seen = found.seen & in_line(found.grid) & (far < 0.3 * spacing_px(coarse))
    if seen.sum() < MIN_SEEN * seen.size:
        return found.grid, seen, found.blur_px
    again = refined(gray, laid_in(found.grid, seen), OFF_PX)
    return again.grid, seen & again.seen & again.whole & in_line(again.grid), again.blur_px


def coarse_grids(gray: cv2.typing.MatLike, board: Board) -> Iterator[tuple[Floats, int]]:
    """Corners (rows, cols, 2) to a third of a reduced image's pixel, and the factor, one reduction after the other."""
    size, tried, any_found = (board.cols, board.rows), set(), False
    for longest, flags in COARSE:
        small, factor = reduced(gray, longest)
        if (factor, flags) in tried:
            continue
        tried.add((factor, flags))
        found, corners = _searched(small, size, flags)
        if found:
            any_found = True
            yield _full_size(corners, factor, board), factor
    if not any_found:
        small, factor = reduced(gray, SECTOR_PX)
        found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if found:
            yield _full_size(corners, factor, board), factor


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


def _searched(gray: cv2.typing.MatLike, size: tuple[int, int], flags: int) -> tuple[bool, cv2.typing.MatLike]:
    """`findChessboardCorners`; where that shall take the image as it is (PLAIN), it gets it in black and white.

    Split by Otsu's threshold, the white a pixel wider so that dark squares no longer touch; its corners, which then are
    those of contours (off by up to 2.5 px), are moved to the corners of the image.
    """
    if flags != cv2.CALIB_CB_PLAIN:
        return cv2.findChessboardCorners(gray, size, flags=flags)
    split = cv2.dilate(cv2.threshold(gray, 0, 255, cv2.THRESH_OTSU)[1], None)  # type: ignore[call-overload]
    found, corners = cv2.findChessboardCorners(split, size, flags=flags)
    return found, cv2.cornerSubPix(gray, corners, (3, 3), (-1, -1), STOP) if found else corners


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
