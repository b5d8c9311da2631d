"""Between the samples of a log: which two stand around a moment, and what holds there.

Attitudes go by slerp, positions by the cubic that keeps the log's velocities, or straight where the log has none that
fit. Nothing is extrapolated, and no gap longer than MAX_GAP_S is bridged.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation

MAX_GAP_S = 3.0
"""Between samples further apart than this nothing is interpolated: a UAV turns and climbs meanwhile."""
VELOCITY_WINDOW_S = 2.0
VELOCITY_TOLERANCE_MPS = 1.0


def within(stamp_s: Floats, time_s: Floats, *, max_gap_s: float = MAX_GAP_S) -> Bools:
    """True (n,) where a time has samples on both sides of it, at most `max_gap_s` apart."""
    if len(stamp_s) < 2:
        return np.zeros(len(time_s), dtype=bool)
    right = np.clip(np.searchsorted(stamp_s, time_s, side="right"), 1, len(stamp_s) - 1)
    bridged = stamp_s[right] - stamp_s[right - 1] <= max_gap_s
    return np.asarray((time_s >= stamp_s[0]) & (time_s <= stamp_s[-1]) & bridged)


def interpolate_position(stamp_s: Floats, enu_m: Floats, velocity_mps: Floats, time_s: Floats, span: Ints) -> Floats:
    """Positions (n, 3) at times (n,) inside spans (n,): the cubic through places and velocities, else the chord."""
    left, right = span, span + 1
    step = stamp_s[right] - stamp_s[left]
    s = (time_s - stamp_s[left]) / step
    chord = enu_m[left] + s[:, None] * (enu_m[right] - enu_m[left])
    if not velocities_fit(stamp_s, enu_m, velocity_mps):
        return np.asarray(chord)
    mean = (enu_m[right] - enu_m[left]) / step[:, None]
    bend = (s * (1 - s) * step)[:, None] * (
        (1 - s)[:, None] * (velocity_mps[left] - mean) - s[:, None] * (velocity_mps[right] - mean)
    )
    return np.where(np.isfinite(bend), chord + bend, chord)


def velocities_fit(stamp_s: Floats, enu_m: Floats, velocity_mps: Floats) -> bool:
    """Whether the velocities are those of the positions: they agree over windows of VELOCITY_WINDOW_S."""
    ahead = np.searchsorted(stamp_s, stamp_s + VELOCITY_WINDOW_S)
    first = np.flatnonzero(ahead < len(stamp_s))
    first = first[:: max(1, len(first) // 1000)]
    if len(first) == 0:
        return False
    last = ahead[first]
    step = np.diff(stamp_s)[:, None]
    travelled = np.concatenate([np.zeros((1, 3)), np.cumsum((velocity_mps[1:] + velocity_mps[:-1]) / 2 * step, axis=0)])
    window = (stamp_s[last] - stamp_s[first])[:, None]
    miss = np.linalg.norm((enu_m[last] - enu_m[first] - (travelled[last] - travelled[first])) / window, axis=1)
    return bool(np.median(miss) < VELOCITY_TOLERANCE_MPS)


def slerp_at(stamp_s: Floats, q: Floats, time_s: Floats, span: Ints) -> Floats:
    """Attitudes (n, 4) at times (n,) inside spans (n,)."""
    share = (time_s - stamp_s[span]) / (stamp_s[span + 1] - stamp_s[span])
    return rotation.slerp(q[span], q[span + 1], share)


def spans(
    stamp_s: Floats, time_s: Floats, frame: Ints, *, source: str, where: str, max_gap_s: float = MAX_GAP_S
) -> Ints:
    """Index (n,) of the sample before each time in non-decreasing `stamp_s`; samples with equal stamps are skipped.

    Raises InputFileError where a time lies outside of the samples or between two further apart than `max_gap_s`.
    """
    outside = ~((time_s >= stamp_s[0]) & (time_s <= stamp_s[-1]))
    if outside.any():
        raise _outside(stamp_s, time_s, frame, outside, source, where)
    span = np.clip(np.searchsorted(stamp_s, time_s, side="right") - 1, 0, len(stamp_s) - 2)
    final = int(np.searchsorted(stamp_s, stamp_s[-1], side="left")) - 1
    span = np.where(stamp_s[span + 1] > stamp_s[span], span, final)
    gap = stamp_s[span + 1] - stamp_s[span]
    if np.any(gap > max_gap_s):
        worst, bad = int(gap.argmax()), gap > max_gap_s
        raise InputFileError(
            where=where,
            seen=f"{source} has no sample between {stamp_s[span[worst]]:.3f} and {stamp_s[span[worst] + 1]:.3f} s"
            f" of log time, where {int(bad.sum())} frames lie (first: {_name(frame, time_s, bad)})",
            expected=f"samples at most {max_gap_s:g} s apart around every frame",
            advice="use the video before or after the gap, or the log stored on board, which has no radio gaps",
        )
    return np.asarray(span, dtype=np.int64)


def _outside(stamp_s: Floats, time_s: Floats, frame: Ints, outside: Bools, source: str, where: str) -> InputFileError:
    away = max(float(stamp_s[0] - np.nanmin(time_s)), float(np.nanmax(time_s) - stamp_s[-1]))
    advice = "check `start` (log time of frame 0)"
    if bool(outside.all()) and away > 3600:
        advice += "; the times are hours apart, so this may be the log of another day or another flight"
    elif not outside.all():
        advice += ", or use only the frames that the log covers"
    return InputFileError(
        where=where,
        seen=f"{int(outside.sum())} of {len(time_s)} frames lie outside of {source}"
        f" (first: {_name(frame, time_s, outside)}; the log covers {stamp_s[0]:.3f} to {stamp_s[-1]:.3f} s)",
        expected="every frame inside the log: poses are interpolated, never extrapolated",
        advice=advice,
    )


def _name(frame: Ints, time_s: Floats, which: Bools) -> str:
    first = int(np.flatnonzero(which)[0])
    return f"frame {int(frame[first])} at {time_s[first]:.3f} s of log time"
