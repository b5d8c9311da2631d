"""What a satellite receiver said of itself over time: its fix, its accuracy, its height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle, whole_numbers

FIX_3D, DIFFERENTIAL, FLOAT, FIXED = 3, 4, 5, 6
FIX_NAMES = {0: "no fix", 1: "no fix", 2: "2D", FIX_3D: "3D", DIFFERENTIAL: "differential", FLOAT: "RTK float",
             FIXED: "RTK fixed"}  # fmt: skip
"""The same numbers in MAVLink (GPS_FIX_TYPE), ArduPilot (GPS.Status) and PX4 (fix_type); others are as a 3D fix."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReceiverSeries:
    """A receiver's rows in time order.

    source      the messages they came from
    time_s      (n,) log time
    fix         (n,) 0 to 6, as FIX_NAMES has them
    horizontal_m, vertical_m  (n,) one sigma per axis as the log states it then; NaN where it does not
    height_m    (n,) the receiver's own, from where the position's heights count; NaN without a 3D fix
    """

    source: str
    time_s: Floats
    fix: Ints
    horizontal_m: Floats
    vertical_m: Floats
    height_m: Floats

    def __post_init__(self) -> None:
        n = len(self.time_s)
        for name in ("time_s", "horizontal_m", "vertical_m", "height_m"):
            settle(self, **{name: frozen(getattr(self, name), (n,), name)})
        settle(self, fix=frozen(self.fix, (n,), "fix", np.int64))


def receiver_series(
    *, source: str, time_s: Floats, fix: Floats, horizontal_m: Floats, vertical_m: Floats, height_m: Floats
) -> ReceiverSeries:
    """Rows (n,) of any order in time order; what is no accuracy (0, none, above 100 m) becomes NaN."""
    order = np.argsort(time_s, kind="stable")
    order = order[np.isfinite(time_s[order])]
    kind = whole_numbers(fix[order])
    kind = np.where((kind >= 0) & (kind <= FIXED), kind, np.where(kind > FIXED, FIX_3D, 0))
    across, up = (
        np.where((value[order] > 0) & (value[order] <= 100.0), value[order], np.nan)
        for value in (horizontal_m, vertical_m)
    )
    return ReceiverSeries(
        source=source, time_s=time_s[order], fix=kind, horizontal_m=across, vertical_m=up,
        height_m=np.where(kind >= FIX_3D, height_m[order], np.nan),
    )  # fmt: skip


def at_times(time_s: Floats, value_time_s: Floats, value: Floats) -> Floats:
    """Values (m,) of another message at times (n,), in proportion to those before and after; NaN without any."""
    told = np.isfinite(value_time_s + value)
    if not told.any():
        return np.full(len(time_s), np.nan)
    order = np.argsort(value_time_s[told], kind="stable")
    return np.asarray(np.interp(time_s, value_time_s[told][order], value[told][order]))
