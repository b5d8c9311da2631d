"""Rows that their own flags call invalid: none of them is a measurement, and that they are there is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.telemetry.log.flight_log import AttitudeSeries, FlightLog, GimbalSeries, PositionSeries
from pipeline.telemetry.log.series import interval_s

FEW = 0.02
"""A share of invalid rows up to here, in no run of BRIDGED_S, is a link's or a driver's ordinary loss."""
BRIDGED_S = 0.5
"""Longer than this a vehicle moves by more than its positions are worth."""


def with_validity_notes(log: FlightLog) -> FlightLog:
    """The log with a note for each series of which rows between valid ones are invalid, or only repeat others."""
    named = (("positions", log.position), ("attitudes", log.attitude), ("gimbal attitudes", log.gimbal))
    said = [note for what, series in named if series is not None and (note := _note(what, series))]
    if log.position is not None and log.position.repeated.any():
        said.append(_staircase(log.position))
    return replace(log, notes=(*log.notes, *said)) if said else log


def _staircase(position: PositionSeries) -> str:
    every, own = (1 / interval_s(position.time_s[rows]) for rows in (position.told, position.valid))
    return f"positions in {position.source} come at {every:.1f} Hz, renewed at {own:.1f} Hz: repetitions are one sample"


def _note(what: str, series: PositionSeries | AttitudeSeries | GimbalSeries) -> str:
    valid = series.told if isinstance(series, PositionSeries) else series.valid
    inside = np.flatnonzero(valid)
    if len(inside) < 2:
        return ""
    lost = np.flatnonzero(~valid[inside[0] : inside[-1]]) + inside[0]
    if not len(lost):
        return ""
    gap = np.diff(series.time_s[inside])
    wide = np.flatnonzero((np.diff(inside) > 1) & (gap > BRIDGED_S))
    if len(lost) < FEW * len(valid) and not len(wide):
        return ""
    note = f"{len(lost)} of {len(valid)} {what} in {series.source} are invalid by the log itself and not used"
    if len(wide):
        first, longest = wide[0], float(gap[wide].max())
        begin, end = series.time_s[inside[first]], series.time_s[inside[first + 1]]
        note += (
            f": {len(wide)} stretches of more than {BRIDGED_S:g} s, the first at log time {begin:.1f} to {end:.1f} s,"
            f" the longest {longest:.1f} s; poses in stretches of up to 3 s are interpolated"
        )
    return note
