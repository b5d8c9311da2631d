"""Series in time order, as every format hands them on."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints, median
from pipeline.telemetry.log.flight_log import AttitudeSeries, Datum, GimbalSeries, PositionSeries
from pipeline.telemetry.log.tables import MessageTable

METRES_PER_DEGREE = 111_320.0
STAIRCASE = 1.5
"""Places that are renewed this much more seldom than they are told are a staircase."""
SLOWEST_RENEWAL_S = 1.1
"""No receiver is slower; places that change more seldom do so because of their digits, or because nothing moves."""
HIGHEST_M = 1e5
"""No vehicle is higher, or deeper: what says so says that it does not know."""
LEAST_STEP_M, LEAST_STEPS = 0.3, 5
"""Steps shorter than this do no harm; fewer than this tell no rate."""


def position_series(
    *,
    source: str,
    datum: Datum,
    height_from: str,
    time_s: Floats,
    lat_deg: Floats,
    lon_deg: Floats,
    height_m: Floats,
    velocity_ned_mps: Floats,
    above_home_m: Floats | None = None,
) -> PositionSeries:
    """Positions (n,) of any order in time order; a place that cannot be becomes NaN."""
    order = _order(time_s)
    bad = ~((np.abs(lat_deg) <= 90) & (np.abs(lon_deg) <= 360) & ~(np.abs(height_m) > HIGHEST_M))
    return PositionSeries(
        source=source,
        datum=datum,
        height_from=height_from,
        time_s=time_s[order],
        lat_rad=np.radians(np.where(bad, np.nan, lat_deg))[order],
        lon_rad=np.radians(np.where(bad, np.nan, lon_deg))[order],
        height_m=np.where(bad, np.nan, height_m)[order],
        velocity_ned_mps=velocity_ned_mps[order],
        above_home_m=np.empty(0) if above_home_m is None else np.where(bad, np.nan, above_home_m)[order],
        repeated=repetitions(time_s[order], lat_deg[order], np.where(bad, np.nan, lon_deg)[order]),
    )


def repetitions(time_s: Floats, lat_deg: Floats, lon_deg: Floats) -> Bools:
    """True (n,) where a row in time order only repeats the place before it, of messages that come faster than places.

    A receiver's 5 Hz told at 30 Hz is a staircase: the first of each step is a sample. A vehicle that really stands is
    told from it by how long it does.
    """
    none = np.zeros(len(time_s), dtype=np.bool_)
    told = np.flatnonzero(np.isfinite(time_s + lat_deg + lon_deg))
    if len(told) < 3:
        return none
    time, lat, lon = time_s[told], lat_deg[told], lon_deg[told]
    north, east = np.diff(lat) * METRES_PER_DEGREE, np.diff(lon) * METRES_PER_DEGREE * np.cos(np.radians(lat[1:]))
    changed = np.concatenate([[True], (north != 0) | (east != 0)])
    steps = np.hypot(north, east)[changed[1:]]
    if len(steps) < LEAST_STEPS or median(steps) < LEAST_STEP_M:
        return none
    renewal, message = interval_s(time[changed]), interval_s(time)
    if not STAIRCASE * message <= renewal <= SLOWEST_RENEWAL_S:
        return none
    since = time - time[changed][np.cumsum(changed) - 1]
    none[told] = ~changed & (since < 2 * renewal)
    return none


def interval_s(time_s: Floats) -> float:
    """Typical time between rows (n,) in time order, those of one moment (two links) taken as one; NaN where none is."""
    step = np.diff(time_s)
    return median(step[step > 0]) if (step > 0).any() else float("nan")


def attitude_series(*, source: str, time_s: Floats, ned_from_body: Floats) -> AttitudeSeries:
    """Attitudes (n, 4) of any order in time order, at unit length; NaN where the length is far from one."""
    order = _order(time_s)
    return AttitudeSeries(source=source, time_s=time_s[order], ned_from_body=_unit(ned_from_body)[order])


def gimbal_series(*, source: str, time_s: Floats, attitude: Floats, frame: Ints) -> GimbalSeries:
    """Mount attitudes (n, 4) of any order in time order."""
    order = _order(time_s)
    return GimbalSeries(source=source, time_s=time_s[order], attitude=_unit(attitude)[order], frame=frame[order])


def denser(first: MessageTable | None, second: MessageTable | None) -> MessageTable | None:
    """`first`, unless `second` has more than twice as many messages."""
    if first is None or second is None:
        return first if second is None else second
    return second if len(second) > 2 * len(first) else first


def close_call(first: MessageTable | None, second: MessageTable | None) -> bool:
    """Whether `denser` could choose otherwise if it saw more of the log."""
    return first is not None and second is not None and 1.5 * len(first) < len(second) < 2.5 * len(first)


def median_of(value: Floats, most: float) -> float:
    """Median of the values that say something (above 0, at most `most`); NaN where none does."""
    said = value[(value > 0) & (value <= most)]
    return median(said) if len(said) else float("nan")


def _order(time_s: Floats) -> Ints | slice:
    """What brings times (n,) into order, NaN last; nothing has to be moved in most logs."""
    return slice(None) if np.all(time_s[1:] >= time_s[:-1]) else np.argsort(time_s, kind="stable")


def _unit(q: Floats) -> Floats:
    length = np.sqrt(sum(q[:, i] ** 2 for i in range(4)))
    length[~(np.abs(length - 1) < 0.05)] = np.nan
    return q / length[:, None]
