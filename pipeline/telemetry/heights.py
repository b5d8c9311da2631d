"""Heights and what they count from: height above the ellipsoid = height above mean sea level + undulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.arrays import Floats
from pipeline.telemetry.flight_log import Datum

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


def on_ellipsoid(mean_sea_level_m: Floats, undulation: Undulation | None) -> tuple[Datum, str, Floats]:
    """Datum, how it was reached, and heights (n,) of heights above mean sea level."""
    if undulation is None:
        words = "above mean sea level: the log does not say how far that is from the ellipsoid"
        return "mean sea level", words, mean_sea_level_m
    words = f"mean sea level + {undulation.metres:.2f} m undulation by the log's own {undulation.source}"
    return "ellipsoid", words, mean_sea_level_m + undulation.metres
