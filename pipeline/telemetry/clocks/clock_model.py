"""One clock against another.

Two clocks a, b that both run steadily: b = b0 + rate * (a - a0). Robustly: the offset is the median of b - a, pairs
further from it than the tolerance are outliers, the rest decides offset and rate by least squares.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from calibration.foundation.arrays import Bools, Floats, median
from pipeline.telemetry.clocks.utc import ROLL_OVER_S, date_of
from pipeline.telemetry.log.flight_log import ClockModel, ClockStep

LARGEST_STEP_S = 60.0
MAX_DRIFT = 2e-3
"""No quartz is worse; a larger slope is noise of a short log, or a log that does not keep up (`_large_slope`)."""
LARGEST_SLOPE = 0.3
STEADY_SHARE = 0.05
"""A large slope is believed where what it leaves is less than this share of what it explains."""
LEAST_FOR_RATE, RATE_SPAN_S = 10, 30.0
"""Readings, and seconds between them, from which a rate is told."""
LEAST_SET = 5
"""Readings in a row that agree: fewer are lies, not a clock that was set."""
NO_LOGS_BEFORE_S = 1_262_304_000.0
"""1 January 2010: none of these formats was written before."""
SET_S = 0.5
"""A clock that was set is moved by more than this: leap seconds that a receiver learns late are whole ones."""


def settled(time_s: Floats) -> Floats:
    """Times (n,) of messages in the order of the file, NaN where a time is a minute off from all around it."""
    if len(time_s) < 5 or bool(np.all(np.abs(np.diff(time_s)) < LARGEST_STEP_S / 3)):  # none is: three rows on at most
        return time_s
    sevens = np.lib.stride_tricks.sliding_window_view(np.pad(time_s, 3, mode="edge"), 7)
    around = np.partition(sevens, 3, axis=1)[:, 3]
    return np.where(np.abs(time_s - around) < LARGEST_STEP_S, time_s, np.nan)


def fit_clock(
    source: str,
    log_s: Floats,
    other_s: Floats,
    *,
    tolerance_s: float = 1.0,
    floor_s: float = 0.0,
    set_later: bool = False,
) -> ClockModel | None:
    """The `other` clock against log time from pairs of readings (n,); None where no majority of them agrees.

    `tolerance_s` separates readings from lies; `floor_s` is the least sigma that the source deserves. With `set_later`
    the other clock may have been set on the way: what it was set to last is believed, and the earlier is told.
    """
    use = np.isfinite(log_s) & np.isfinite(other_s)
    if not use.any():
        return None
    log, other = (log_s, other_s) if use.all() else (log_s[use], other_s[use])
    slope = _large_slope(log, other)
    steps: tuple[ClockStep, ...] = ()
    if set_later:
        last, steps = _set_last(log, other - slope * (log - log[0]))
        log, other = log[last], other[last]
    log_epoch, epoch = median(log), median(other)
    since = log - log_epoch
    late = other - epoch - (1.0 + slope) * since
    offset, rate = median(late), 1.0
    good = np.abs(late - offset) < tolerance_s + MAX_DRIFT * np.abs(since)
    if 2 * good.sum() <= len(good):
        return None
    if not good.all():
        since, late = since[good], late[good]
    if len(late) >= LEAST_FOR_RATE and np.ptp(since) > RATE_SPAN_S:
        centred = since - since.mean()
        drift = float(centred @ late / (centred @ centred))
        rate = 1.0 + drift if abs(drift) < MAX_DRIFT else 1.0
    late -= (rate - 1.0) * since
    offset = median(late)
    scatter = 1.4826 * median(np.abs(late - offset))
    return ClockModel(
        source=source,
        epoch_s=epoch + offset,
        log_epoch_s=log_epoch,
        rate=rate + slope,
        sigma_s=max(scatter, floor_s),
        pairs=len(late),
        outliers=len(good) - len(late),
        steps=steps,
    )


def _large_slope(log_s: Floats, other_s: Floats) -> float:
    """How much faster the other clock runs, where that is more than any quartz drifts and all readings bear it out.

    An autopilot that cannot keep up loses time: its log's clock is as wrong as its loop is slow.
    """
    order = np.argsort(log_s, kind="stable")
    log, late = log_s[order], (other_s - log_s)[order]
    if len(log) < LEAST_FOR_RATE or np.ptp(log) <= RATE_SPAN_S:
        return 0.0
    half = len(log) // 2
    step = log[half:] - log[: len(log) - half]
    apart = step > 0.1 * np.ptp(log)
    if not apart.any():
        return 0.0
    slope = median((late[half:] - late[: len(log) - half])[apart] / step[apart])
    if not MAX_DRIFT < abs(slope) < LARGEST_SLOPE:
        return 0.0
    flat = late - slope * (log - log[0])
    scatter = median(np.abs(flat - median(flat)))
    return slope if scatter < STEADY_SHARE * abs(slope) * np.ptp(log) else 0.0


def _set_last(log_s: Floats, other_s: Floats) -> tuple[Bools, tuple[ClockStep, ...]]:
    """Which readings (n,) agree with what the other clock was set to last, and what it read before, each time.

    How far it was moved is told at the moment itself, for clocks also drift.
    """
    order = np.argsort(log_s, kind="stable")
    late = (other_s - log_s)[order]
    smooth = late
    if len(late) >= 5:
        smooth = np.partition(np.lib.stride_tricks.sliding_window_view(np.pad(late, 2, mode="edge"), 5), 2, axis=1)[
            :, 2
        ]
    drift = MAX_DRIFT * np.diff(log_s[order])
    bounds = np.concatenate([[0], np.flatnonzero(np.abs(np.diff(smooth)) > SET_S + drift) + 1, [len(late)]])
    parts = [np.arange(a, b) for a, b in pairwise(bounds.tolist()) if b - a >= LEAST_SET]
    everything = np.ones(len(late), dtype=bool)
    if len(parts) < 2:
        return everything, ()
    kept, steps, away = np.zeros(len(late), dtype=bool), [], 0.0
    kept[order[parts[-1]]] = True
    for part, after in reversed(list(pairwise(parts))):
        away += float(median(late[part[-LEAST_SET:]]) - median(late[after[:LEAST_SET]]))
        if abs(away) <= SET_S:
            kept[order[part]] = True
        else:
            begin, end = log_s[order[part[0]]], log_s[order[part[-1]]]
            steps.append(ClockStep(begin_s=float(begin), end_s=float(end), ahead_s=away))
    return (kept, tuple(reversed(steps))) if steps else (everything, ())


def utc_notes(utc: ClockModel | None) -> list[str]:
    """What a reader should know of how UTC was told: a log that runs slow, clocks that were set on the way."""
    if utc is None:
        return []
    notes = []
    if abs(utc.rate - 1) > MAX_DRIFT:
        way, share = "slow" if utc.rate > 1 else "fast", 100 * abs(utc.rate - 1)
        notes.append(
            f"the log's clock runs {share:.1f} % {way} against {utc.source}: {share:.1f} s in 100 s of log time;"
            " frames are placed in it at that rate"
        )
    for step in utc.steps:
        notes.append(
            f"UTC by {utc.source} was {_seconds(step.ahead_s)} from log time {step.begin_s:.1f} to {step.end_s:.1f} s,"
            f" before it was set; that is not used (log time 0 would be {date_of(utc.other_s(0.0) + step.ahead_s)})"
        )
    if utc.outliers:
        notes.append(f"{utc.outliers} of {utc.outliers + utc.pairs} readings of UTC by {utc.source} are not used")
    if utc.other_s(utc.log_epoch_s) < NO_LOGS_BEFORE_S:
        later = date_of(utc.other_s(utc.log_epoch_s) + ROLL_OVER_S)
        notes.append(
            f"UTC by {utc.source} is {date_of(utc.other_s(utc.log_epoch_s))}, before such logs were written: a receiver"
            f" whose week rolled over would mean {later}"
        )
    return notes


def _seconds(ahead_s: float) -> str:
    return f"{abs(ahead_s):.1f} s {'ahead' if ahead_s > 0 else 'behind'}"
