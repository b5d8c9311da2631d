"""What the instruments behind a log are worth.

A satellite fix errs by nearly the same amount for minutes (atmosphere, orbits, multipath): what the receiver states
is the constant part, and a third of it moves from sample to sample. Where a log states nothing, the defaults of
InstrumentSigma stand, widened by the digits that positions were
written with: 3 m constant and 1 m moving for a single-frequency receiver, 0.5 and 0.5 degrees for an
autopilot's attitude.
"""

from __future__ import annotations

import numpy as np

from pipeline.records import InstrumentSigma
from pipeline.telemetry.log.flight_log import FlightLog, PositionSeries
from pipeline.telemetry.log.series import METRES_PER_DEGREE

MOVING_SHARE = 1 / 3
LEAST_MOVING_M = 0.02
LEAST_DIGITS_M = 0.1
"""Digits that cost less than this are lost beside any receiver."""


def log_sigma(log: FlightLog) -> InstrumentSigma:
    """One sigma per axis of a log's poses, from what the log says, else the documented defaults."""
    default = InstrumentSigma()
    said = [s for s in (log.accuracy.horizontal_m, log.accuracy.vertical_m) if np.isfinite(s)]
    constant = float(np.sqrt(np.mean(np.square(said)))) if said else default.position_bias_m
    moving = max(constant * MOVING_SHARE, LEAST_MOVING_M) if said else default.position_m
    digits = 0.0 if log.position is None else digits_sigma_m(log.position)
    if digits > LEAST_DIGITS_M:
        constant, moving = float(np.hypot(constant, digits)), float(np.hypot(moving, digits))
    heading = log.accuracy.heading_rad
    return InstrumentSigma(
        attitude_bias_rad=max(default.attitude_bias_rad, heading)
        if np.isfinite(heading)
        else default.attitude_bias_rad,
        position_bias_m=constant,
        position_m=moving,
    )


def digits_sigma_m(position: PositionSeries) -> float:
    """What the digits of places cost, one sigma per axis: four decimals of a degree are 11 m apart."""
    keep = position.valid
    places = np.unique(np.degrees(np.stack([position.lat_rad[keep], position.lon_rad[keep]], axis=1)), axis=0)
    if len(places) < 2:
        return 0.0
    for decimals in range(7):
        scaled = places * 10.0**decimals
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-4):
            return METRES_PER_DEGREE * 10.0**-decimals / float(np.sqrt(12))
    return 0.0
