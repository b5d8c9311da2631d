"""What the instruments behind a log are worth.

A satellite fix errs by nearly the same amount for minutes (atmosphere, orbits, multipath): what the receiver states
is the constant part, and a third of it moves from sample to sample. Where a log states nothing, the defaults of
InstrumentSigma stand: 3 m constant and 1 m moving for a single-frequency receiver, 0.5 and 0.5 degrees for an
autopilot's attitude.
"""

from __future__ import annotations

import numpy as np

from pipeline.records import InstrumentSigma
from pipeline.telemetry.log.flight_log import FlightLog

MOVING_SHARE = 1 / 3
LEAST_MOVING_M = 0.02


def log_sigma(log: FlightLog) -> InstrumentSigma:
    """One sigma per axis of a log's poses, from what the log says, else the documented defaults."""
    default = InstrumentSigma()
    said = [s for s in (log.accuracy.horizontal_m, log.accuracy.vertical_m) if np.isfinite(s)]
    constant = float(np.sqrt(np.mean(np.square(said)))) if said else default.position_bias_m
    moving = max(constant * MOVING_SHARE, LEAST_MOVING_M) if said else default.position_m
    heading = log.accuracy.heading_rad
    return InstrumentSigma(
        attitude_bias_rad=max(default.attitude_bias_rad, heading)
        if np.isfinite(heading)
        else default.attitude_bias_rad,
        position_bias_m=constant,
        position_m=moving,
    )
