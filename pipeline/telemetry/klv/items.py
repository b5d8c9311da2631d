"""What the items of ST 0601 mean, those that a pose needs.

Whole numbers are mapped onto a range, in degrees and metres:

    unsigned  low + u (high - low) / (2^bits - 1)
    signed    s half / (2^(bits - 1) - 1); the least whole number means "error" or "out of range", and is no value
    IMAPB     (ST 1201) the same for any length, by powers of two; values with the top bit set are none of the range
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from calibration.foundation.arrays import Floats

Decode = Callable[[bytes], float]
NOTHING = float("nan")

TIME, HEADING, PITCH, ROLL = 2, 5, 6, 7
DESIGNATION, SOURCE = 10, 11
LATITUDE, LONGITUDE, TRUE_ALTITUDE, FIELD_ACROSS, FIELD_UP = 13, 14, 15, 16, 17
AZIMUTH, ELEVATION, SENSOR_ROLL = 18, 19, 20
ELLIPSOID_HEIGHT, FULL_PITCH, FULL_ROLL, WIDE_ELLIPSOID_HEIGHT, LEAP_SECONDS = 75, 90, 91, 104, 136


def unsigned(size: int, low: float, high: float) -> Decode:
    """A whole number of `size` bytes onto low ... high."""

    def decode(value: bytes) -> float:
        if len(value) != size:
            return NOTHING
        return low + int.from_bytes(value, "big") * (high - low) / ((1 << 8 * size) - 1)

    return decode


def signed(size: int, half: float) -> Decode:
    """A whole number of `size` bytes onto -half ... half."""

    def decode(value: bytes) -> float:
        number = int.from_bytes(value, "big", signed=True)
        if len(value) != size or number == -(1 << 8 * size - 1):
            return NOTHING
        return number * half / ((1 << 8 * size - 1) - 1)

    return decode


def imapb(low: float, high: float) -> Decode:
    """ST 1201's IMAPB of any length onto low ... high."""

    def decode(value: bytes) -> float:
        bits = 8 * len(value)
        number = int.from_bytes(value, "big")
        if not bits or number > 1 << (bits - 1):  # the top bit: infinities, no number, errors; alone it is `high`
            return NOTHING
        scale = 2.0 ** (bits - 1 - math.ceil(math.log2(high - low)))
        offset = scale * low - math.floor(scale * low) if low < 0 < high else 0.0
        return (number - offset) / scale + low

    return decode


def seconds(value: bytes) -> float:
    """Microseconds since 1970."""
    return int.from_bytes(value, "big") * 1e-6 if len(value) == 8 else NOTHING


def whole(value: bytes) -> float:
    """A signed whole number."""
    return float(int.from_bytes(value, "big", signed=True)) if value else NOTHING


ITEMS: Mapping[int, Decode] = {
    TIME: seconds,
    HEADING: unsigned(2, 0, 360),
    PITCH: signed(2, 20),
    ROLL: signed(2, 50),
    LATITUDE: signed(4, 90),
    LONGITUDE: signed(4, 180),
    TRUE_ALTITUDE: unsigned(2, -900, 19000),
    FIELD_ACROSS: unsigned(2, 0, 180),
    FIELD_UP: unsigned(2, 0, 180),
    AZIMUTH: unsigned(4, 0, 360),
    ELEVATION: signed(4, 180),
    SENSOR_ROLL: unsigned(4, 0, 360),
    ELLIPSOID_HEIGHT: unsigned(2, -900, 19000),
    FULL_PITCH: signed(4, 90),
    FULL_ROLL: signed(4, 90),
    WIDE_ELLIPSOID_HEIGHT: imapb(-900, 40000),
    LEAP_SECONDS: whole,
}


def column(sets: Sequence[Mapping[int, bytes]], item: int) -> Floats:
    """One item of every set (n,): NaN where a set does not have it, or says that it has no value."""
    decode = ITEMS[item]
    return np.array([decode(found[item]) if item in found else NOTHING for found in sets], float)
