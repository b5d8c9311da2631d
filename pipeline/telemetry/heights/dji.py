"""DJI's heights: above sea level by its barometer, else above the take-off place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.heights.geoid import geoid_height_m, geoid_name
from pipeline.telemetry.heights.takeoff import HOME_NOTE
from pipeline.telemetry.log.flight_log import Datum

RECEIVER_SIGMA_M = 3.0
"""A receiver of one frequency, of which nothing is stated."""
ABSOLUTE_SIGMA_M = 50.0
"""DJI's abs_alt is the pressure's height in the standard atmosphere, near sea level 8 m a hectopascal: weather is 50 m,
and public samples are off by as much."""
BAROMETER_SIGMA_M = 3.0
"""Above home: what pressure drifts during a flight, and what a take-off height from a map is worth."""
EQUAL_M = 0.002
"""Two heights closer than this throughout are one height, written twice: formats round to a millimetre."""
LOWEST_LAND_M = -30.0
"""A take-off place below this is a wrong pressure: only a few basins are lower."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DJIHeights:
    """Heights (n,), what they count from and how they came to it, what they are worth, and notes."""

    datum: Datum
    words: str
    height_m: Floats
    sigma_m: float
    notes: tuple[str, ...]


def dji_heights(absolute_m: Floats, above_home_m: Floats, lat_deg: Floats, lon_deg: Floats) -> DJIHeights:
    """Of heights (n,) above sea level by the barometer and above the take-off place; NaN where one is not given."""
    notes: tuple[str, ...] = ()
    if np.isfinite(absolute_m).any():
        takeoff = absolute_m - above_home_m
        ground = float(np.nanmedian(takeoff)) if np.isfinite(takeoff).any() else float(np.nanmedian(absolute_m))
        if np.isfinite(takeoff).any() and np.nanmax(np.abs(takeoff)) < EQUAL_M:
            notes = ("DJI's altitude repeats the height above the take-off place: it says nothing, and is not used",)
        elif ground > LOWEST_LAND_M:
            above = geoid_height_m(np.radians(lat_deg), np.radians(lon_deg))
            return DJIHeights(
                datum="ellipsoid",
                words=f"altitude, taken as above mean sea level, + undulation by {geoid_name()}",
                height_m=absolute_m + above,
                sigma_m=ABSOLUTE_SIGMA_M,
                notes=(f"DJI's altitude is by its barometer: {ABSOLUTE_SIGMA_M:.0f} m, one sigma, as a whole",),
            )
        else:
            notes = (f"altitudes put the take-off place at {ground:.0f} m, where no land is: they are not used",)
    return DJIHeights(
        datum="home",
        words="heights above the take-off place",
        height_m=above_home_m,
        sigma_m=BAROMETER_SIGMA_M,
        notes=(*notes, f"{HOME_NOTE}: the log does not say how high that is; `takeoff` does"),
    )
