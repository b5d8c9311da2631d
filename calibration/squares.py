"""What the squares around corners look like: is there a corner at all, and how sharp is it.

At a corner of a checkerboard two opposite squares are dark and two are bright, and which two alternates from corner
to corner. With neighbours e1 (next column) and e2 (next row), the tone difference

    contrast = ((+ +) + (- -) - (+ -) - (- +)) / 2 * (-1)^(column + row),   (s t) = gray at corner + 0.35 (s e1 + t e2)

is then the same all over the board; where something hides a corner it is not.
"""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import Bools, Floats

SEEN_SHARE = 0.35


def seen_corners(gray: cv2.typing.MatLike, grid: Floats) -> Bools:
    """(rows, cols) true where the image shows a corner; `grid` is (rows, cols, 2) pixels."""
    return np.asarray(_alternating(gray, grid, 0.35) & _alternating(gray, grid, 0.2) & in_line(grid))


def _alternating(gray: cv2.typing.MatLike, grid: Floats, reach: float) -> Bools:
    """Where the four squares around a corner alternate in tone as its neighbours' do."""
    e1, e2 = steps(grid)
    tones = {(s, t): _sample(gray, grid + reach * (s * e1 + t * e2)) for s in (-1, 1) for t in (-1, 1)}
    row, col = np.mgrid[: grid.shape[0], : grid.shape[1]]
    sign = np.where((row + col) % 2, -1.0, 1.0)
    contrast = sign * (tones[1, 1] + tones[-1, -1] - tones[1, -1] - tones[-1, 1]) / 2
    typical = float(np.median(contrast))
    if abs(typical) < 4:
        return np.zeros(sign.shape, bool)
    across = np.maximum(np.abs(tones[1, 1] - tones[-1, -1]), np.abs(tones[1, -1] - tones[-1, 1]))
    strong = contrast / typical > SEEN_SHARE
    return np.asarray(strong & (across < 1.2 * np.abs(contrast) + 0.25 * abs(typical)))


def in_line(grid: Floats) -> Bools:
    """Where a corner lies with the others on a smooth surface: a homography and a cubic on top of it."""
    rows, cols = grid.shape[:2]
    y, x = np.mgrid[:rows, :cols]
    x, y = (x / (cols - 1) * 2 - 1).ravel(), (y / (rows - 1) * 2 - 1).ravel()
    plane = np.stack([x, y], axis=1)
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
    flat, good = grid.reshape(-1, 2), np.ones(len(x), bool)
    for _ in range(3):
        if good.sum() < 12:
            break
        first, _ = cv2.findHomography(plane[good], flat[good])
        if np.ndim(first) != 2:
            break
        off = flat - cv2.perspectiveTransform(plane[None], first)[0]
        off = off - terms @ np.linalg.lstsq(terms[good], off[good], rcond=None)[0]
        far = np.linalg.norm(off, axis=1)
        before, good = good, far < max(0.5, 0.03 * spacing_px(grid), 5 * float(np.median(far)))
        if np.array_equal(before, good):
            break
    return good.reshape(rows, cols)


def edge_blur_px(gray: cv2.typing.MatLike, grid: Floats) -> tuple[float, float]:
    """Blur (a Gaussian's sigma, pixels) across the board's row edges and column edges: (smaller, larger).

    Along a profile across an edge, sigma = step / (sqrt(2 pi) steepest slope). A camera that moved while it
    exposed blurs one of the two directions more. Median over the edges.
    """
    e1, e2 = steps(grid)
    along_rows = _edge_sigma(gray, (grid[:, :-1] + grid[:, 1:]) / 2, e2[:, :-1])
    along_cols = _edge_sigma(gray, (grid[:-1] + grid[1:]) / 2, e1[:-1])
    return min(along_rows, along_cols), max(along_rows, along_cols)


def steps(grid: Floats) -> tuple[Floats, Floats]:
    """Vectors to the next column and to the next row, (rows, cols, 2) each."""
    return np.gradient(grid, axis=1), np.gradient(grid, axis=0)


def spacing_px(grid: Floats) -> float:
    """Smallest distance between neighbouring corners."""
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    return float(min(across.min(), down.min()))


def _edge_sigma(gray: cv2.typing.MatLike, middle: Floats, across: Floats) -> float:
    """Median sigma of the edges at `middle` (m, k, 2), profiles along `across` to 0.35 of it either side."""
    length = float(np.median(np.linalg.norm(across, axis=2))) * 0.7
    count = int(np.clip(round(3 * length), 9, 61))
    place = np.linspace(-0.35, 0.35, count)
    tone = _sample(gray, middle[..., None, :] + place[:, None] * across[..., None, :])
    step = np.abs(tone[..., -1] - tone[..., 0])
    spread = np.linalg.norm(across, axis=2) * 0.7 / (count - 1)
    slope = np.abs(np.diff(tone, axis=-1)).max(axis=-1) / spread
    good = step > 4
    if not good.any():
        return float("nan")
    return float(np.median(step[good] / slope[good]) / np.sqrt(2 * np.pi))


def _sample(gray: cv2.typing.MatLike, points: Floats) -> Floats:
    flat = points.reshape(-1, 2).astype(np.float32)
    tone = cv2.remap(gray, flat[:, None, 0], flat[:, None, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(tone, float).reshape(points.shape[:-1])
