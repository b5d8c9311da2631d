"""UTC out of GPS time, and which UTC can be a flight's."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from calibration.foundation.arrays import Bools, Floats

EARLIEST_UTC_S = 1_104_537_600.0
"""1 January 2005: no vehicle that logs these formats flew before."""
LATEST_UTC_S = 4_102_444_800.0
"""1 January 2100."""
GPS_EPOCH_S = 315_964_800.0
ROLL_OVER_S = 1024 * 604_800.0
"""GPS weeks are sent in ten bits."""
LEAP_SECONDS = np.array(
    [46828800, 78364801, 109900802, 173059203, 252028804, 315187205, 346723206, 393984007, 425520008, 457056009,
     504489610, 551750411, 599184012, 820108813, 914803214, 1025136015, 1119744016, 1167264017],
    dtype=float,
)  # fmt: skip
"""GPS seconds at which GPS time drew one second further ahead of UTC (IERS Bulletin C; none since 2017)."""


def plausible_utc(posix_s: Floats) -> Bools:
    """True where a POSIX time can be a flight's."""
    return np.asarray((posix_s > EARLIEST_UTC_S) & (posix_s < LATEST_UTC_S))


def believed_utc(source: str, log_s: Floats, posix_s: Floats) -> tuple[Floats, tuple[str, ...]]:
    """UTC (n,) read at log times (n,), NaN where it cannot be a flight's; and what is said of those that cannot.

    Zero and less is a clock that says nothing.
    """
    good = plausible_utc(posix_s)
    other = np.isfinite(log_s) & np.isfinite(posix_s) & (posix_s > 0) & ~good
    kept = np.where(good, posix_s, np.nan)
    if not other.any():
        return kept, ()
    first = int(np.flatnonzero(other)[0])
    said = (
        f"{int(other.sum())} of {int((other | good).sum())} readings of UTC by {source} cannot be a flight's and are"
        f" not used: {date_of(posix_s[first])} at log time {log_s[first]:.1f} s"
    )
    rolled = [later for weeks in (1, 2) if plausible_utc(later := posix_s[first] + weeks * ROLL_OVER_S)]
    if rolled and posix_s[first] > GPS_EPOCH_S:
        said += f"; a receiver whose week rolled over would mean {date_of(rolled[0])}"
    return kept, (said,)


def date_of(posix_s: float) -> str:
    """A time in ISO 8601, to the second."""
    if not 0 <= posix_s < LATEST_UTC_S:
        return f"{posix_s:.0f} s after 1970"
    return datetime.fromtimestamp(posix_s, UTC).isoformat(timespec="seconds")


def utc_from_gps(week: Floats, week_s: Floats) -> Floats:
    """POSIX seconds (n,) of GPS weeks and seconds of the week: GPS time minus the leap seconds since 1980."""
    gps_s = np.asarray(week, float) * 604_800.0 + np.asarray(week_s, float)
    return np.asarray(GPS_EPOCH_S + gps_s - np.searchsorted(LEAP_SECONDS, gps_s, side="right"))
