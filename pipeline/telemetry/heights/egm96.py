"""Mean sea level above the ellipsoid where no log says it: the earth gravitational model EGM96.

`egm96_15min.xz` is the public-domain grid of the U.S. National Geospatial-Intelligence Agency as it was published:
centimetres every 15 minutes, rows from the north pole, columns from Greenwich to the east. A flight is over one place,
so it is stored in bands of BAND rows and the first row of the next, each its own xz stream behind one that holds their
lengths (uint32): second differences d[i, j] = g[i, j] - g[i, j-1] - g[i-1, j] + g[i-1, j-1] inside the band, in
little-endian int16, low bytes first, then high bytes. Between grid points: bilinear.
"""

from __future__ import annotations

import lzma
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats

ROWS, COLUMNS, PER_DEGREE = 721, 1440, 4
BAND = 20
FILE = Path(__file__).with_name("egm96_15min.xz")


@cache
def _streams() -> tuple[bytes, ...]:
    head = lzma.LZMADecompressor()
    lengths = np.frombuffer(head.decompress(FILE.read_bytes()), "<u4").tolist()
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(head.unused_data[begin:end] for begin, end in pairwise(ends))


@cache
def _band_m(band: int) -> Floats:
    """Rows BAND * band and the BAND after it, (BAND + 1, COLUMNS)."""
    planes = np.frombuffer(lzma.decompress(_streams()[band]), np.uint8).reshape(2, -1)
    second = np.ascontiguousarray(planes.T).view("<i2").reshape(-1, COLUMNS).astype(np.int64)
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
    out, band = np.full(row.shape, np.nan), top // BAND
    for one in np.flatnonzero(np.bincount(band[known])).tolist():
        here, grid = known & (band == one), _band_m(one)
        t, le, r, d, a = (value[here] for value in (top - BAND * one, left, right, down, across))
        upper = grid[t, le] * (1 - a) + grid[t, r] * a
        lower = grid[t + 1, le] * (1 - a) + grid[t + 1, r] * a
        out[here] = upper * (1 - d) + lower * d
    return out
