"""Where exactly a corner is: its two edges, each averaged along its length and compared with a blurred step.

Near a corner the board's grid is, in pixels, x(a, b) = p + a e1 + b e2 + a^2 d11 / 2 + a b d12 + b^2 d22 / 2 with a, b
counted in squares and e, d the differences of the neighbouring corners, so that the edges are a = 0 and b = 0 even
where the lens bends them. Across the edge a = 0 the brightness is, for blur sigma,

    I(s, b) = I_0 + C sign(b) erf((s - s_0) / sqrt(2)),      s = a |dx/da| sin / sigma

Its least-squares shift, to first order, is one product of what is sampled in a strip along the edge with fixed weights
(brightness of the squares, a gradient of the light and the other edge are orthogonal to it):

    s_0 = - (sum w(b) g(s) I) / (C sum w^2 g^2),   g = derivative of the step, w = sign(b) softened by the other edge

This uses every pixel by which the corner could move: two to five times the accuracy of `cornerSubPix`, which weighs
squared gradients of the noise too, and takes edges as straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import erf

import cv2
import numpy as np

from calibration.detection.squares import edge_blur_px, middle_of, steps
from calibration.foundation.arrays import Bools, Floats

REACH = 0.42
"""How far along an edge is looked, in squares: short of the next corner's blur."""

ACROSS = np.linspace(-2.4, 2.4, 7)
"""Where the brightness is sampled across an edge, in sigmas of its blur."""

START_BLUR_PX, LEAST_BLUR_PX = 2.0, 0.6
ALONG_PX, MOST_ALONG = 2.0, 16
LEAST_LENGTH = 1e-3
CLEAR_CHANGE_PX = 0.25
"""Of the second difference from one corner to the next: several times its noise."""

SEEN_SHARE, LEAST_CONTRAST = 0.35, 4.0
"""Contrast of a corner that is there: over the usual one, and in gray levels."""

LEAST_APART_PX, TIMES_APART = 0.2, 8.0
"""The halves of an edge may want the corner this far apart, or this many times what is usual: else it is hidden."""


_STEP = np.array([erf(s / np.sqrt(2)) for s in ACROSS])
_SLOPE = np.exp(-(ACROSS**2) / 2) * np.sqrt(2 / np.pi)
_TO_STEP = (_STEP / (_STEP @ _STEP)).astype(np.float32)
_TO_SHIFT = (_SLOPE / (_SLOPE @ _SLOPE)).astype(np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """What the image shows of a board's corners.

    grid (rows, cols, 2)  the corners, to about 0.01 px where they are there
    seen (rows, cols)     two opposite squares are dark, two bright, and which two alternates from corner to corner
    whole (rows, cols)    nothing hides a part of the corner's edges
    dark_first            the square before the first corner, diagonally, is dark
    blur_px               of the edges (`edge_blur_px`)
    """

    grid: Floats
    seen: Bools
    whole: Bools
    dark_first: bool
    blur_px: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """The corners (rows, cols, 2) after one step; of both edges and their halves on either side of the corner, the
    contrast (2, n, 2) in gray levels, and how far apart the halves want the edge (2, n)."""

    grid: Floats
    contrast: Floats
    apart_px: Floats


def refined(gray: cv2.typing.MatLike, grid: Floats, off_px: float) -> Refined:
    """The corners near `grid` (rows, cols, 2), which is `off_px` off."""
    near = sharpened(gray, grid, max(START_BLUR_PX, off_px), straight=True).grid
    if off_px > START_BLUR_PX:
        near = sharpened(gray, near, START_BLUR_PX, straight=True).grid
    blur = edge_blur_px(gray, near)
    usual = float(np.hypot(*blur) / np.sqrt(2))
    last = sharpened(gray, near, max(LEAST_BLUR_PX, usual) if usual == usual else 1.0)
    whole = last.apart_px < max(LEAST_APART_PX, TIMES_APART * middle_of(last.apart_px))
    signed = _signed(last.contrast.reshape(2, *grid.shape[:2], 2))
    typical = middle_of(signed)
    return Refined(
        grid=last.grid,
        seen=np.asarray((signed / (typical or 1.0) > SEEN_SHARE).all(axis=(0, 3)) & (abs(typical) >= LEAST_CONTRAST)),
        whole=np.asarray(whole.all(axis=0).reshape(grid.shape[:2])),
        dark_first=typical < 0,
        blur_px=blur,
    )


def _signed(contrast: Floats) -> Floats:
    """Contrasts (2, rows, cols, 2), every other corner's turned round: one sign all over a board that is seen."""
    row, col = np.ogrid[: contrast.shape[1], : contrast.shape[2]]
    return np.asarray(contrast * (1 - 2 * ((row + col) % 2))[:, :, None])


def sharpened(
    gray: cv2.typing.MatLike, grid: Floats, blur_px: float, *, straight: bool = False, clear: float = REACH
) -> Moved:
    """Corners (rows, cols, 2) moved once, on edges as wide as `blur_px`; at most by twice that.

    `straight` is for the first steps: what the lens bends is left out, and every other pixel along the edges. Nothing
    is sampled further across an edge than `clear` squares: markers begin there.
    """
    surface = _plane(grid) if straight else _surface(grid)
    across = surface[:, :, :, 2].copy()
    length = np.sqrt(np.maximum(across[:, :, 0] ** 2 + across[:, :, 1] ** 2, LEAST_LENGTH))
    area = np.maximum(np.abs(across[0, :, 0] * across[1, :, 1] - across[0, :, 1] * across[1, :, 0]), LEAST_LENGTH)
    sigma = blur_px * length[::-1] / area
    narrow = np.minimum(sigma, min(REACH, clear) / ACROSS[-1])
    sparse = 2 if straight else 1
    along, terms = _strip(2 * int(np.clip(REACH * middle_of(length) / (sparse * ALONG_PX), 4, MOST_ALONG // 2)))
    surface[:, :, :, 2] *= narrow[:, :, None]
    if not straight:
        surface[:, :, :, 4] *= narrow[:, :, None]
        surface[:, :, :, 5] *= narrow[:, :, None] ** 2
    x, y = (
        surface[:, :, k].reshape(-1, surface.shape[3]).astype(np.float32) @ terms[: surface.shape[3]] for k in (0, 1)
    )
    tone = cv2.remap(gray, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    strips = np.asarray(tone, np.float32).reshape(*sigma.shape, 2, len(along) // 2, len(ACROSS))
    softened = [np.tanh(along / middle_of(sigma[edge])) for edge in (1, 0)]
    weight = np.array(softened, np.float32).reshape(2, 1, 2, 1, -1)
    halves = (weight @ strips)[:, :, :, 0]
    moved = narrow * np.minimum(np.maximum(_shift(halves[:, :, 0] + halves[:, :, 1])[0], -2), 2)
    shift, contrast = _shift(halves)
    return Moved(
        grid=np.asarray(grid + (moved[0, :, None] * across[0] + moved[1, :, None] * across[1]).reshape(grid.shape)),
        contrast=2 * contrast / np.abs(weight[:, :, :, 0]).sum(axis=3),
        apart_px=np.abs(shift[:, :, 0] - shift[:, :, 1]) * narrow / sigma * blur_px,
    )


def _shift(profile: np.typing.NDArray[np.floating]) -> tuple[Floats, Floats]:
    """Where the step in profiles (..., s) of the brightness across an edge is, in sigmas, and its size."""
    contrast = profile @ _TO_STEP
    size = np.where(contrast < 0, -1, 1) * np.maximum(np.abs(contrast), 1e-3)
    return np.asarray(-(profile @ _TO_SHIFT) / size, float), np.asarray(contrast, float)


def _plane(grid: Floats) -> Floats:
    """(2, n, 2, 3) for both edges, every corner, x and y: the factors of 1, b, a, a across the edge."""
    e1, e2 = steps(grid)
    both = np.stack([grid, e2, e1, grid, e1, e2])
    return np.ascontiguousarray(both.reshape(2, 3, -1, 2).transpose(0, 2, 3, 1))


def _surface(grid: Floats) -> Floats:
    """(2, n, 2, 6) for both edges, every corner, x and y: the factors of 1, b, a, b^2, a b, a^2, a across the edge."""
    rows, cols = grid.shape[:2]
    e1, d1 = _derivatives(grid)
    e2, d2 = (v.swapaxes(0, 1) for v in _derivatives(grid.swapaxes(0, 1)))
    mixed = (_differences(rows)[:rows] @ e1.reshape(rows, -1)).reshape(grid.shape)
    both = np.empty((2, 6, *grid.shape))
    both[:, 0], both[:, 4] = grid, mixed
    both[0, 1] = both[1, 2] = e2
    both[0, 2] = both[1, 1] = e1
    both[0, 3] = both[1, 5] = d2 / 2
    both[0, 5] = both[1, 3] = d1 / 2
    return np.ascontiguousarray(both.reshape(2, 6, rows * cols, 2).transpose(0, 2, 3, 1))


def _derivatives(grid: Floats) -> tuple[Floats, Floats]:
    """First and second derivative along the second axis; beyond its ends the second changes only where it clearly does.

    What a lens does to a small board changes so little from corner to corner that taking the change from four corners
    would add more noise than it mends; at the rim of a wide lens it is pixels.
    """
    cols = grid.shape[1]
    both = _differences(cols) @ grid
    first, second = both[:, :cols], both[:, cols:]
    if cols < 4:
        return first, second
    for end, one, two, sign in ((0, 1, 2, 1), (-1, -2, -3, -1)):
        third = second[:, two] - second[:, one]
        if np.abs(third).max() > CLEAR_CHANGE_PX:
            third = np.where(np.abs(third).max(axis=1, keepdims=True) > CLEAR_CHANGE_PX, third, 0.0)
            second[:, end] -= third
            first[:, end] += sign * third / 3
    return first, second


@lru_cache(maxsize=16)
def _differences(count: int) -> Floats:
    """(2 count, count): first and, below, second derivatives at evenly spaced places; the second ends as it was."""
    first, second = np.zeros((count, count)), np.zeros((count, count))
    for i in range(count):
        k = min(max(i, 1), count - 2)
        second[i, k - 1 : k + 2] = 1, -2, 1
        first[i, k - 1 : k + 2] = np.array([-0.5, 0, 0.5]) + (i - k) * np.array([1, -2, 1])
    return np.concatenate([first, second])


@lru_cache(maxsize=16)
def _strip(count: int) -> tuple[Floats, np.typing.NDArray[np.float32]]:
    """Places along an edge, in squares, evenly about the corner; and the terms of `_surface` over a strip."""
    along = ((np.arange(count) + 0.5) / count * 2 - 1) * REACH
    b, a = (v.ravel() for v in np.meshgrid(along, ACROSS, indexing="ij"))
    return along, np.stack([np.ones_like(a), b, a, b * b, a * b, a * a]).astype(np.float32)
