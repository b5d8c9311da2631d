"""Boots that a clock does not fall back at: of two logs joined, the second may begin later than the first ended.

A boot clock that leaps lost messages, or is another boot's. Another clock beside it (the recorder's, UTC) goes on by as
much in the first case, by another amount in the second, for the vehicle was off, and had run before.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.foundation.arrays import Floats, Ints, median
from pipeline.telemetry.clocks.clock_model import LARGEST_SLOPE
from pipeline.telemetry.clocks.utc import ROLL_OVER_S

LEAP_S = 3.0
"""A boot clock that goes on by more than this from one message to the next leaps."""
APART_S = 30.0
"""A clock that goes on by so much more or less over a leap than the boot clock is beside another boot's: GPS time is
known to leap seconds, and an autopilot that was on for less did not fly."""
BESIDE, LEAST = 16, 2
"""Readings of the other clock on each side of a leap that are looked at, and those that are needed."""
MOST_LEAPS = 10_000


def leaps_of(boot_s: Floats) -> Ints:
    """Indices at which a boot clock (n,), in the order of the file, leaps."""
    return (
        np.flatnonzero(np.diff(boot_s, prepend=boot_s[:1]) > LEAP_S)[:MOST_LEAPS] if len(boot_s) else np.empty(0, int)
    )


def other_boots(boot_s: Floats, other_s: Floats, restart: Ints) -> Mapping[int, bool]:
    """Of leaps of a boot clock (n,), those of which another clock (n,), NaN where it says nothing, tells: whether
    another boot begins there. `restart` (r,) are boots known already: what lies beyond them is no neighbour."""
    leaps, late = leaps_of(boot_s), other_s - boot_s
    told, found = np.flatnonzero(np.isfinite(late)), {}
    bounds = np.sort(np.concatenate([[0], restart, leaps, [len(boot_s)]]))
    for leap in leaps.tolist():
        here = int(np.searchsorted(told, leap))
        begin, end = bounds[bounds < leap][-1], bounds[bounds > leap][0]
        before, after = told[max(0, here - BESIDE) : here], told[here : here + BESIDE]
        before, after = before[before >= begin], after[after < end]
        if min(len(before), len(after)) >= LEAST:
            apart = median(late[after]) - median(late[before])
            apart -= ROLL_OVER_S * round(apart / ROLL_OVER_S)  # a receiver that learns its week
            found[leap] = abs(apart) > APART_S + LARGEST_SLOPE * float(boot_s[leap] - boot_s[leap - 1])
    return found


def begun_anew(boot_s: Floats, record_s: Floats, unix_s: Floats, restart: Ints) -> Ints:
    """Leaps of a boot clock (n,) at which another boot begins, by the recorder's clock (n,) and the vehicle's UTC (n,).

    Two that contradict each other tell of a recorder that was set.
    """
    by_record, by_unix = (other_boots(boot_s, clock, restart) for clock in (record_s, unix_s))
    said = {**by_unix, **by_record}
    return np.array([i for i, anew in sorted(said.items()) if anew and by_unix.get(i, True)], dtype=np.int64)
