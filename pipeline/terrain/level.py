"""A level ground: one height above the ellipsoid or above mean sea level, wherever one looks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry.geodesy import SEMI_MAJOR_M, Geodetic
from pipeline.records import GroundAt, GroundHeights

Geoid = Callable[[Floats, Floats], Floats]
"""Latitude and longitude (n,) in radians -> mean sea level above the ellipsoid (n,), metres."""
ROUGH_SHARE = 0.1
"""Of `sigma_m`: how far a level ground rises and falls along a stretch. Doubling it loosens the height of a moving
target against its own mean, which matters little beside `sigma_m`."""


def level_ground(height_m: float, origin: Geodetic, sigma_m: float, geoid: Geoid | None = None) -> GroundAt:
    """Level ground at `height_m` above the ellipsoid; with a `geoid`, above mean sea level."""
    if geoid is not None:
        height_m += float(geoid(np.array([origin.lat_rad]), np.array([origin.lon_rad]))[0])
    up = height_m - origin.height_m

    def at(place_m: Floats) -> GroundHeights:
        drop = (place_m**2).sum(axis=1) / (2 * SEMI_MAJOR_M)
        count = len(place_m)
        return GroundHeights(
            up_m=up - drop, slope=-place_m / SEMI_MAJOR_M, rough_m=np.full(count, ROUGH_SHARE * sigma_m),
            known=np.ones(count, dtype=bool),
        )  # fmt: skip

    return at
