"""Heights and what they count from: height above the ellipsoid = height above mean sea level + undulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.heights.egm96 import geoid_height_m

LARGEST_UNDULATION_M = 120.0
"""The geoid stays between -107 m and +86 m."""


@dataclass(frozen=True, kw_only=True)
class Undulation:
    """Height of mean sea level above the ellipsoid where the flight was, and who says so."""

    metres: float
    source: str


def undulation_of(source: str, difference_m: Floats) -> Undulation | None:
    """From (n,) differences ellipsoid minus mean sea level of one receiver; None where they are none or impossible."""
    possible = difference_m[np.abs(difference_m) < LARGEST_UNDULATION_M]
    return Undulation(metres=float(np.median(possible)), source=source) if len(possible) else None


def on_ellipsoid(
    mean_sea_level_m: Floats, undulation: Undulation | None, lat_deg: Floats, lon_deg: Floats
) -> tuple[str, Floats]:
    """How they got there, and heights (n,) above the ellipsoid of heights above mean sea level at places (n,).

    By the log's own undulation where it has one: the receiver that gave the heights used it. Else by EGM96.
    """
    if undulation is not None:
        words = f"mean sea level + {undulation.metres:.2f} m undulation by the log's own {undulation.source}"
        return words, mean_sea_level_m + undulation.metres
    above = geoid_height_m(np.radians(lat_deg), np.radians(lon_deg))
    middle = float(np.nanmedian(above)) if np.isfinite(above).any() else float("nan")
    words = f"mean sea level + {middle:.2f} m undulation by EGM96 (the log gives no height above the ellipsoid)"
    return words, mean_sea_level_m + above
