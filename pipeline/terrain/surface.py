"""Heights between the cells of a raster, their slope, and what the cells do not show.

Between four cells heights are bilinear. What that misses is estimated from the model itself: where every second cell is
left out, the line through its neighbours misses it by e; at the model's own cells it misses half as much (ground whose
detail grows in proportion to its size), and root of 8/15 of that on average along a cell.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.terrain.mapping import Smooth

HALF, ALONG = 0.5, 0.73
"""Of e, see above. Doubling `HALF` doubles what is claimed not to be known between cells."""
LEAST_M = 0.05
"""Metres: kerbs, ruts, springs. Doubling it loosens the height of a moving target against its own mean."""
NEIGHBOURS = 5
"""Cells a side over which the roughness is a mean."""


class Surface:
    """`heights` (rows, columns) in metres, NaN where unknown, with `cells`: column and row of a place in ENU.

    lift: what is added to a height to make it ENU up, a function of the place. See `GroundAt`; plain arrays come out.
    """

    def __init__(self, heights: Floats, cells: Smooth, lift: Smooth) -> None:
        self.known = np.isfinite(heights)
        self.heights = _filled(heights, self.known)
        self.rough = _roughness(self.heights)
        self.cells, self.lift = cells, lift

    def at(self, place_m: Floats) -> tuple[Floats, Floats, Floats, Bools]:
        """ENU up (n,), slope (n, 2), roughness (n,), and whether all four cells around are known (n,)."""
        cell, by_place = self.cells.at(place_m)
        lift, lift_slope = self.lift.at(place_m)
        rows, columns = self.heights.shape
        inside = (cell >= 0).all(axis=1) & (cell[:, 0] <= columns - 1) & (cell[:, 1] <= rows - 1)
        column = np.clip(cell[:, 0], 0, columns - 1)
        row = np.clip(cell[:, 1], 0, rows - 1)
        left, top = np.minimum(column.astype(int), columns - 2), np.minimum(row.astype(int), rows - 2)
        x, y = column - left, row - top
        a, b = self.heights[top, left].astype(float), self.heights[top, left + 1].astype(float)
        c, d = self.heights[top + 1, left].astype(float), self.heights[top + 1, left + 1].astype(float)
        value = (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y
        by_column, by_row = (b - a) * (1 - y) + (d - c) * y, (c - a) * (1 - x) + (d - b) * x
        slope = by_column[:, None] * by_place[..., 0] + by_row[:, None] * by_place[..., 1]
        whole = self.known[top, left] & self.known[top, left + 1] & self.known[top + 1, left]
        whole &= self.known[top + 1, left + 1]
        slope = np.where(inside[:, None], slope, 0.0)
        rough = np.hypot(self.rough[top, left].astype(float), LEAST_M)
        return value + lift[:, 0], slope + lift_slope[..., 0], rough, inside & whole


def _filled(heights: Floats, known: Bools) -> Floats:
    """Voids as high as the nearest cell that is known."""
    if known.all():
        return heights
    from scipy.ndimage import distance_transform_edt  # slow to import

    near = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(heights[tuple(near)])


def _roughness(heights: Floats) -> Floats:
    from scipy.ndimage import uniform_filter  # slow to import

    square = np.zeros(heights.shape, dtype=np.float32)
    for axis in range(2):
        if heights.shape[axis] > 2:
            mid, low, high = ([slice(None), slice(None)] for _ in range(3))
            mid[axis], low[axis], high[axis] = slice(1, -1), slice(None, -2), slice(2, None)
            off = heights[tuple(mid)] - 0.5 * (heights[tuple(low)] + heights[tuple(high)])
            padded = np.pad(
                off.astype(np.float32) ** 2, [(1, 1) if i == axis else (0, 0) for i in range(2)], mode="edge"
            )
            square += padded
    return np.asarray(HALF * ALONG * np.sqrt(uniform_filter(square, NEIGHBOURS, mode="nearest")))
