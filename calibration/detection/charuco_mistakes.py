"""Why a ChArUco board is not found, or not the one described: what the markers in the photos say themselves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.boards.board import Board
from calibration.boards.charuco import charuco_board
from calibration.detection.charuco import find_charuco

LEAST_MARKERS = 6
"""Markers of another dictionary that are no accident: one in a thousand cells of clutter reads as some marker."""

MOST_ASKED, ASKED_PX = 2, 1000
"""Photos, and their longer side, that are asked for markers of every dictionary: seconds of work, done once and only
where nothing was found."""

MARKER_OFF = 0.05
"""Of the marker's side: a ruler is right to 0.02, corners of small markers to 0.02."""

Image = cv2.typing.MatLike


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """What is wrong with a board's description: the option, what was given, what the photos show, the advice."""

    where: str
    seen: str
    expected: str
    advice: str


def why_not_found(grays: Sequence[Image], board: Board) -> Mistake | None:
    """The reason why no photo shows `board`, where the photos tell one."""
    if any(find_charuco(255 - np.asarray(gray), board, "") is not None for gray in grays):
        return Mistake(
            where="photos",
            seen="an inverted board: markers white on black, found only in the negative",
            expected="black markers on white, as `runningfix board` prints them",
            advice="print it with black and white exchanged; of a thermal camera exchange hot and cold",
        )
    turned = replace(board, cols=board.rows, rows=board.cols)
    if board.cols != board.rows and any(find_charuco(gray, turned, "") is not None for gray in grays):
        return Mistake(
            where="--board",
            seen=board.name,
            expected=f"{turned.name}: the numbers of the markers run along the other side",
            advice=f"--board {turned.name}",
        )
    return _other_dictionary(grays, board)


def _other_dictionary(grays: Sequence[Image], board: Board) -> Mistake | None:
    """Another dictionary that reads more markers in the photos."""
    counts: Counter[str] = Counter()
    asked = [_reduced(gray) for gray in grays[:MOST_ASKED]]
    for name in _families():
        detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)))
        for gray in asked:
            _, ids, _ = detector.detectMarkers(gray)
            counts[name] += 0 if ids is None else len(np.unique(ids))
    best, most = counts.most_common(1)[0]
    given = counts[_family(board.dictionary)]
    if most < LEAST_MARKERS or most < 2 * given or best == _family(board.dictionary):
        return None
    needed = (board.cols + 1) * (board.rows + 1) // 2
    kind = best.rpartition("_")[0]
    held = [n for n in (50, 100, 250, 1000) if n >= needed and hasattr(cv2.aruco, f"{kind}_{n}")]
    fitting = f"{kind}_{held[0]}" if held and best.endswith("_1000") else best
    return Mistake(
        where="--dictionary",
        seen=board.dictionary,
        expected=f"that of the {most} markers in the photos asked, which are of {kind if held else best}",
        advice=f"--dictionary {fitting} (or another size of the same kind: {kind}_50 to _1000)",
    )


def _reduced(gray: Image) -> Image:
    scale = min(1.0, ASKED_PX / max(gray.shape))
    return cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else gray


def _families() -> list[str]:
    """The largest dictionary of each kind: it holds the smaller ones."""
    every = [name for name in dir(cv2.aruco) if name.startswith("DICT_") and name.isupper()]
    return [name for name in every if not name.endswith(("_50", "_100", "_250"))]


def _family(name: str) -> str:
    kind, _, size = name.rpartition("_")
    return f"{kind}_1000" if size in ("50", "100", "250") and hasattr(cv2.aruco, f"{kind}_1000") else name.upper()


def wrong_marker(grays: Sequence[Image], board: Board) -> Mistake | None:
    """Where the markers' side is clearly another share of the square's than `board` says."""
    shares = [share for gray in grays for share in _marker_shares(gray, board)]
    if len(shares) < LEAST_MARKERS or board.marker_m is None:
        return None
    measured = float(np.median(shares)) * board.square_m
    if abs(measured / board.marker_m - 1) < MARKER_OFF:
        return None
    return Mistake(
        where="--marker-mm",
        seen=f"{board.marker_m * 1000:g} mm beside squares of {board.square_m * 1000:g} mm",
        expected=f"markers of {measured * 1000:.1f} mm, as in the photos asked",
        advice=f"measure square and marker; --marker-mm {measured * 1000:.1f} if the squares are right",
    )


def _marker_shares(gray: Image, board: Board) -> list[float]:
    """The side of each marker over the square's, by the homography of the corners around it."""
    found = find_charuco(gray, board, "")
    if found is None:
        return []
    detector = cv2.aruco.ArucoDetector(charuco_board(board).getDictionary())
    corners, _, _ = detector.detectMarkers(gray)
    flat, _ = cv2.findHomography(found.corners, board.points_m[found.index, :2] / board.square_m)
    if np.ndim(flat) != 2:
        return []
    sides = []
    for marker in corners:
        on_board = cv2.perspectiveTransform(np.asarray(marker, np.float64).reshape(1, 4, 2), flat)[0]
        sides.append(float(np.linalg.norm(np.roll(on_board, 1, axis=0) - on_board, axis=1).mean()))
    return sides
