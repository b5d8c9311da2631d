"""Mean sea level above the ellipsoid where no log says it: the earth gravitational model EGM96.

`egm96_15min.xz` is the public-domain grid of the U.S. National Geospatial-Intelligence Agency as it was published:
centimetres every 15 minutes, rows from the north pole, columns from Greenwich to the east. It is stored as second
differences d[i, j] = g[i, j] - g[i, j-1] - g[i-1, j] + g[i-1, j-1] in little-endian int16, low bytes first, then high
bytes. Between grid points: bilinear.
"""

from __future__ import annotations

import lzma
from functools import cache
from importlib import resources

import numpy as np

from calibration.foundation.arrays import Floats

ROWS, COLUMNS, PER_DEGREE = 721, 1440, 4


@cache
def _grid_m() -> Floats:
    raw = lzma.decompress(resources.files(__package__).joinpath("egm96_15min.xz").read_bytes())
    planes = np.frombuffer(raw, np.uint8).reshape(2, -1)
    second = np.ascontiguousarray(planes.T).view("<i2").reshape(ROWS, COLUMNS).astype(np.int64)
    grid = np.asarray(np.cumsum(np.cumsum(second, axis=0), axis=1) / 100.0)
    grid.setflags(write=False)
    return grid


def geoid_height_m(lat_rad: Floats, lon_rad: Floats) -> Floats:
    """Height (n,) of mean sea level above the WGS84 ellipsoid; NaN where a place is."""
    row = np.clip((90.0 - np.degrees(np.asarray(lat_rad, float))) * PER_DEGREE, 0, ROWS - 1)
    column = np.mod(np.degrees(np.asarray(lon_rad, float)) * PER_DEGREE, COLUMNS)
    known = np.isfinite(row + column)
    row, column = np.where(known, row, 0.0), np.where(known, column, 0.0)
    top, left = np.minimum(row.astype(int), ROWS - 2), column.astype(int) % COLUMNS
    right, down, across = (left + 1) % COLUMNS, row - top, column - column.astype(int)
    grid = _grid_m()
    upper = grid[top, left] * (1 - across) + grid[top, right] * across
    lower = grid[top + 1, left] * (1 - across) + grid[top + 1, right] * across
    return np.where(known, upper * (1 - down) + lower * down, np.nan)
