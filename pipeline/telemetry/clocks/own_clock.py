"""The log's own clock: what it counts from, how fast it runs, and what is to be said of UTC."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, median
from pipeline.telemetry.clocks.clock_model import MAX_DRIFT, utc_notes
from pipeline.telemetry.log.flight_log import ClockModel, FlightLog

POSIX_FROM_S = 1e8
"""Seconds above this count from 1970: no autopilot runs for three years."""
OWN_SIGMA_S = 1.0
"""Of a log's clock that counts from 1970 and that no receiver confirms."""


def counts_from_1970(log: FlightLog) -> bool:
    """Whether log time itself is POSIX time, as of simulators and companion computers."""
    for series in (log.position, log.attitude):
        if series is not None and np.isfinite(series.time_s).any():
            return bool(median(series.time_s[~np.isnan(series.time_s)]) > POSIX_FROM_S)
    return False


def with_clock_notes(log: FlightLog) -> FlightLog:
    """The log with what its clocks have against themselves said; UTC by its own clock where nothing better knows it."""
    notes = utc_notes(log.utc)
    utc = log.utc
    if counts_from_1970(log):
        if utc is None:
            source = "the log's own clock, which counts from 1970"
            utc = ClockModel(
                source=source, epoch_s=0.0, log_epoch_s=0.0, rate=1.0, sigma_s=OWN_SIGMA_S, pairs=0, outliers=0
            )
        elif abs(late := utc.other_s(utc.log_epoch_s) - utc.log_epoch_s) > 2 * OWN_SIGMA_S:
            notes.append(
                f"log time counts from 1970 and is {abs(late):.0f} s {'behind' if late > 0 else 'ahead of'} UTC by"
                f" {utc.source}: a `start` in seconds is log time, one in UTC is the receiver's"
            )
    return replace(log, utc=utc, notes=(*log.notes, *notes)) if notes or utc is not log.utc else log


def log_seconds(log: FlightLog, true_s: Floats) -> Floats:
    """How far log time goes on in true seconds (n,): not as far, of a log whose clock runs slow beyond all drift."""
    if log.utc is None or abs(log.utc.rate - 1) <= MAX_DRIFT:
        return true_s
    return np.asarray(true_s / log.utc.rate)
