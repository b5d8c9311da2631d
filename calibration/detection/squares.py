"""What the squares around corners look like: do the corners lie on one surface, and how sharp are their edges."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from calibration.foundation.arrays import Bools, Floats

ASKED = 16
"""Edges each way whose blur is measured."""


def in_line(grid: Floats) -> Bools:
    """Where a corner lies with the others on a smooth surface: a homography and a cubic on top of it."""
    rows, cols = grid.shape[:2]
    plane, terms, leaves = _surface(rows, cols)
    flat, least = grid.reshape(-1, 2), max(0.5, 0.03 * spacing_px(grid))
    outermost = [0, cols - 1, rows * cols - 1, (rows - 1) * cols]
    first = cv2.getPerspectiveTransform(plane[outermost].astype(np.float32), flat[outermost].astype(np.float32))
    off = leaves @ (flat - cv2.perspectiveTransform(plane[None], first)[0])
    if np.hypot(off[:, 0], off[:, 1]).max() < least:
        return np.ones((rows, cols), bool)
    good = np.ones(rows * cols, bool)
    for _ in range(3):
        if good.sum() < 12:
            break
        first, _ = cv2.findHomography(plane[good], flat[good])
        if np.ndim(first) != 2:
            break
        off = flat - cv2.perspectiveTransform(plane[None], first)[0]
        off = off - terms @ np.linalg.lstsq(terms[good], off[good], rcond=None)[0]
        far = np.linalg.norm(off, axis=1)
        before, good = good, far < max(least, 5 * float(np.median(far)))
        if np.array_equal(before, good):
            break
    return good.reshape(rows, cols)


def laid_in(grid: Floats, seen: Bools) -> Floats:
    """The grid with the corners that were not `seen` where a smooth surface through the others puts them."""
    rows, cols = grid.shape[:2]
    plane, terms, _ = _surface(rows, cols)
    flat, good = grid.reshape(-1, 2), seen.ravel()
    first, _ = cv2.findHomography(plane[good], flat[good])
    if np.ndim(first) != 2:
        return grid
    smooth = cv2.perspectiveTransform(plane[None], first)[0]
    smooth = smooth + terms @ np.linalg.lstsq(terms[good], (flat - smooth)[good], rcond=None)[0]
    return np.where(seen[..., None], grid, smooth.reshape(rows, cols, 2))


@lru_cache(maxsize=16)
def _surface(rows: int, cols: int) -> tuple[Floats, Floats, Floats]:
    """Grid places (n, 2) from -1 to 1, cubic terms (n, 10) there, and what a fit of those leaves (n, n)."""
    y, x = np.mgrid[:rows, :cols]
    x, y = (x / (cols - 1) * 2 - 1).ravel(), (y / (rows - 1) * 2 - 1).ravel()
    terms = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
    return np.stack([x, y], axis=1), terms, np.eye(len(x)) - terms @ np.linalg.pinv(terms)


PROFILE_REACH = 0.35
"""How far to either side of an edge its blur is looked for, in squares."""


def edge_blur_px(gray: cv2.typing.MatLike, grid: Floats, *, reach: float = PROFILE_REACH) -> tuple[float, float]:
    """Blur (a Gaussian's sigma, pixels) across the board's row edges and column edges: (smaller, larger).

    Along a profile across an edge, sigma = step / (sqrt(2 pi) steepest slope). A camera that moved while it
    exposed blurs one of the two directions more. Median over the edges, of which at most some 16 each way are asked,
    up to `reach` squares from the edge.
    """
    e1, e2 = steps(grid)
    ways = (((grid[:, :-1] + grid[:, 1:]) / 2, e2[:, :-1]), ((grid[:-1] + grid[1:]) / 2, e1[:-1]))
    some = [[v.reshape(-1, 2)[:: 1 + v.size // (2 * ASKED)] for v in way] for way in ways]
    middle, across = (np.concatenate([way[k] for way in some]) for k in (0, 1))
    slopes, first = _edge_sigmas(gray, middle, across, reach), len(some[0][0])
    found = [middle_of(s[s < np.inf]) if (s < np.inf).any() else float("nan") for s in (slopes[:first], slopes[first:])]
    return min(found), max(found)


def steps(grid: Floats) -> tuple[Floats, Floats]:
    """Vectors to the next column and to the next row, (rows, cols, 2) each."""
    return _gradient(grid), _gradient(grid.swapaxes(0, 1)).swapaxes(0, 1)


def _gradient(grid: Floats) -> Floats:
    """Central differences along the second axis, one-sided at its ends."""
    made = np.empty_like(grid)
    made[:, 1:-1] = (grid[:, 2:] - grid[:, :-2]) / 2
    made[:, 0], made[:, -1] = grid[:, 1] - grid[:, 0], grid[:, -1] - grid[:, -2]
    return made


def spacing_px(grid: Floats) -> float:
    """Smallest distance between neighbouring corners."""
    across, down = grid[:, 1:] - grid[:, :-1], grid[1:] - grid[:-1]
    return float(np.sqrt(min(_squares(across).min(), _squares(down).min())))


def middle_of(values: Floats) -> float:
    """The median (the upper of two middle ones), many times quicker than numpy's on small arrays."""
    return float(np.sort(values, axis=None)[values.size // 2])


def _squares(vectors: Floats) -> Floats:
    return np.asarray(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)


def _edge_sigmas(gray: cv2.typing.MatLike, middle: Floats, across: Floats, reach: float) -> Floats:
    """(k,) sigma of the edges at `middle` (k, 2), profiles to `reach` of `across` either side; inf: no edge."""
    length = np.sqrt(_squares(across)) * (2 * reach)
    count = int(np.clip(round(3 * middle_of(length)), 9, 61))
    place = np.linspace(-reach, reach, count)
    tone = _sample(gray, middle[:, None, :] + place[:, None] * across[:, None, :])
    step = np.abs(tone[:, -1] - tone[:, 0])
    slope = np.abs(tone[:, 1:] - tone[:, :-1]).max(axis=1) / (length / (count - 1))
    return np.where(step > 4, step / np.maximum(slope, 1e-9) / float(np.sqrt(2 * np.pi)), np.inf)


def _sample(gray: cv2.typing.MatLike, points: Floats) -> Floats:
    flat = points.reshape(1, -1, 2).astype(np.float32)
    tone = cv2.remap(gray, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(tone, float).reshape(points.shape[:-1])
