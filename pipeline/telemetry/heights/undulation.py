"""Heights and what they count from: height above the ellipsoid = height above mean sea level + undulation.

A log's own undulation is held against EGM96. A receiver, or a driver, that knows none repeats the one height in both
fields; so does an autopilot that was told to give ellipsoidal heights throughout (GPS_DRV_OPTIONS). Equal fields
therefore say nothing, and what they may mean is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, median
from pipeline.telemetry.heights.geoid import geoid_height_m, geoid_name

LARGEST_UNDULATION_M = 120.0
"""The geoid stays between -107 m and +86 m."""
EQUAL_M = 0.002
"""Two heights closer than this throughout are one height, written twice: formats round to a millimetre."""
CLEAR_M = 0.5
"""Where EGM96 itself is within this of nothing, equal heights are no contradiction."""
APART_M = 5.0
"""EGM96 is right to a metre or two; a log's undulation further from it is doubted aloud."""
MODEL_PLACES = 1 << 14
"""Of more places so many, evenly chosen, tell the geoid's height as well: it changes by metres in tens of km."""
ELLIPSOID_OPTION = 16
"""Bit 4 of ArduPilot's GPS_DRV_OPTIONS: heights are above the ellipsoid in every field that says mean sea level."""


@dataclass(frozen=True, kw_only=True)
class Undulation:
    """Height of mean sea level above the ellipsoid where the flight was, and who says so.

    metres  NaN where the log's own is not to be believed
    ellipsoidal  whether the fields for mean sea level are above the ellipsoid already
    notes   one sentence each
    """

    metres: float
    source: str
    ellipsoidal: bool = False
    notes: tuple[str, ...] = ()

    @property
    def believed(self) -> bool:
        """Whether the log's own heights above the ellipsoid are."""
        return bool(np.isfinite(self.metres)) and not self.ellipsoidal


def undulation_of(
    source: str, difference_m: Floats, lat_deg: Floats, lon_deg: Floats, *, equal_m: float = EQUAL_M
) -> Undulation | None:
    """From (n,) differences ellipsoid minus mean sea level of one receiver at places (n,); None without any.

    Heights within `equal_m` of each other throughout are one height: what the format rounds to.
    """
    possible = np.abs(difference_m) < LARGEST_UNDULATION_M
    if not possible.any():
        return None
    own = median(difference_m[possible])
    model = _middle_m(lat_deg[possible], lon_deg[possible])
    if np.all(np.abs(difference_m[possible]) < equal_m) and abs(model) > CLEAR_M:
        return Undulation(
            metres=float("nan"),
            source=source,
            notes=(
                f"{source} gives one height as above the ellipsoid and above mean sea level: it says nothing, and is"
                f" taken as above mean sea level, {model:.1f} m undulation by {geoid_name()}; if it is above the"
                f" ellipsoid, all heights are {model:.1f} m too high",
            ),
        )
    notes: tuple[str, ...] = ()
    if abs(own - model) > APART_M:
        notes = (
            f"{source} has {own:.1f} m between ellipsoid and mean sea level, {geoid_name()} {model:.1f} m:"
            f" {abs(own - model):.1f} m apart; the log's own is used",
        )
    return Undulation(metres=own, source=source, notes=notes)


def told_ellipsoidal(options: float | None) -> Undulation | None:
    """What GPS_DRV_OPTIONS says of heights; None where it says nothing."""
    if options is None or not int(options) & ELLIPSOID_OPTION:
        return None
    said = f"GPS_DRV_OPTIONS = {int(options)}: heights are above the ellipsoid, also where messages say mean sea level"
    return Undulation(metres=0.0, source="GPS_DRV_OPTIONS", ellipsoidal=True, notes=(said,))


def on_ellipsoid(
    mean_sea_level_m: Floats, undulation: Undulation | None, lat_deg: Floats, lon_deg: Floats
) -> tuple[str, Floats]:
    """How they got there, and heights (n,) above the ellipsoid of heights above mean sea level at places (n,).

    By the log's own undulation where it has one: the receiver that gave the heights used it. Else by EGM96.
    """
    if undulation is not None and undulation.ellipsoidal:
        return f"above the ellipsoid already, by {undulation.source}", mean_sea_level_m
    if undulation is not None and undulation.believed:
        words = f"mean sea level + {undulation.metres:.2f} m undulation by the log's own {undulation.source}"
        return words, mean_sea_level_m + undulation.metres
    above = geoid_height_m(np.radians(lat_deg), np.radians(lon_deg))
    why = "the log gives no height above the ellipsoid" if undulation is None else "the log's own says nothing"
    words = f"mean sea level + {_median(above):.2f} m undulation by {geoid_name()} ({why})"
    return words, mean_sea_level_m + above


def _middle_m(lat_deg: Floats, lon_deg: Floats) -> float:
    """The geoid's median height at places (n,), of many at MODEL_PLACES of them."""
    few = slice(None, None, 1 + len(lat_deg) // MODEL_PLACES)
    return _median(geoid_height_m(np.radians(lat_deg[few]), np.radians(lon_deg[few])))


def _median(value: Floats) -> float:
    return median(value[~np.isnan(value)]) if np.isfinite(value).any() else float("nan")
