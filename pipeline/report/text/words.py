"""Figures as people read them: value and sigma to the digits that the sigma supports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime

MINUS, PLUS_MINUS, TIMES, DASH, SIGMA = "\u2212", "\u00b1", "\u00d7", "\u2013", "\u03c3"
NARROW = "\u202f"
RAISED = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
UNKNOWN = "unknown"


def rounded(value: float, digits: int = 2) -> str:
    """`value` to `digits` significant digits, without an exponent where people would not use one."""
    if not math.isfinite(value):
        return UNKNOWN
    if value == 0:
        return "0"
    power = math.floor(math.log10(abs(value)))
    if not -5 <= power <= 9:
        return _signed(f"{value / 10.0**power:.{max(digits - 1, 0)}f} {TIMES} 10{str(power).translate(RAISED)}")
    places = max(digits - 1 - power, 0)
    return _signed(f"{value:,.{places}f}".replace(",", NARROW))


def fixed(value: float, places: int) -> str:
    """`value` with `places` decimals, "unknown" for NaN."""
    if not math.isfinite(value):
        return UNKNOWN
    return _signed(f"{round(value, places) + 0.0:,.{places}f}".replace(",", NARROW))


def _signed(words: str) -> str:
    return words.replace("-", MINUS)


def sigma_places(sigma: float) -> int:
    """Decimals that a positive sigma supports: two of its digits while they are below 36, else one."""
    power = math.floor(math.log10(sigma))
    leading = round(sigma / 10 ** (power - 1))
    return (1 if leading < 36 else 0) - power


def plus_minus(value: float, sigma: float, unit: str = "") -> str:
    """ "1.600 +- 0.004 s"; a sigma of zero means held; where it is unknown, a question mark."""
    tail = f"\u00a0{unit}" if unit else ""
    if not math.isfinite(value):
        return UNKNOWN
    if sigma == 0:
        return f"{rounded(value, 6) if value else '0'}{tail}"
    if not math.isfinite(sigma) or sigma < 1e-12:
        return f"{rounded(value, 5)} {PLUS_MINUS} ?{tail}"
    places = sigma_places(sigma)
    if places > 9:
        return f"{rounded(value, 4)}{tail} {PLUS_MINUS} {rounded(sigma)}"
    value, sigma = (round(v, places) + 0.0 for v in (value, sigma))
    return f"{fixed(value, max(places, 0))} {PLUS_MINUS} {fixed(sigma, max(places, 0))}{tail}"


def counted(n: int, singular: str, plural: str = "") -> str:
    """ "1 camera", "4 targets", "50 000 sightings"."""
    return f"{whole(n)} {singular if n == 1 else plural or singular + 's'}"


def whole(n: int) -> str:
    """A count with its thousands set apart."""
    return f"{n:,}".replace(",", NARROW)


def listed(words: Sequence[str]) -> str:
    """ "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


def utc(posix_s: float) -> str:
    """A UTC time to the hundredth of a second."""
    hundredths = round(posix_s * 100)
    at = datetime.fromtimestamp(hundredths // 100, UTC)
    return f"{at:%Y-%m-%d %H:%M:%S}.{hundredths % 100:02d} UTC"


def degrees_of_place(lat_deg: float, lon_deg: float, places: int = 5) -> str:
    """Latitude and longitude with their letters."""
    return (
        f"{abs(lat_deg):.{places}f}\u00b0{'N' if lat_deg >= 0 else 'S'} "
        f"{abs(lon_deg):.{places}f}\u00b0{'E' if lon_deg >= 0 else 'W'}"
    )
