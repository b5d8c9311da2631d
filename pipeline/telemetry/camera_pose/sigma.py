"""What the instruments behind a log are worth.

A satellite fix errs by nearly the same amount for minutes (atmosphere, orbits, multipath): what the receiver states
is the constant part, and a third of it moves from sample to sample. It is taken over the moments that are asked for, as
the root of the mean square: a fix that comes and goes counts by its time. Where a log states nothing, its kind of fix
tells; heights that are not the receiver's own (a barometer's) are held against the receiver's. Where that says nothing
either, the defaults of InstrumentSigma stand, widened by the digits that positions were written with: 3 m constant and
1 m moving for a single-frequency receiver, 0.5 and 0.5 degrees for an autopilot's attitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.records import InstrumentSigma
from pipeline.telemetry.log.flight_log import FlightLog, PositionSeries
from pipeline.telemetry.log.receiver import DIFFERENTIAL, FIX_3D, FIX_NAMES, FIXED, FLOAT, ReceiverSeries
from pipeline.telemetry.log.series import METRES_PER_DEGREE

MOVING_SHARE = 1 / 3
LEAST_MOVING_M = 0.02
LEAST_DIGITS_M = 0.1
"""Digits that cost less than this are lost beside any receiver."""
FIX_SIGMA_M = {FIX_3D: 3.0, DIFFERENTIAL: 1.5, FLOAT: 0.4, FIXED: 0.03}
"""One sigma per axis of a fix whose accuracy nobody states: receivers' data sheets, a clear sky."""
LEAST_HEIGHTS = 10
"""Receiver's heights beside the position's, from which these are held against those."""
FAR_M = 50.0
"""Between two heights, which is no drift of pressure."""
Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class PositionWorth:
    """One sigma per axis of positions over some moments, across and up; NaN where nothing says it; and notes."""

    horizontal_m: float
    vertical_m: float
    notes: tuple[str, ...] = ()


def log_sigma(log: FlightLog, span: Span | None = None) -> InstrumentSigma:
    """One sigma per axis of a log's poses, from what it says (within the log times `span`), else the defaults."""
    default = InstrumentSigma()
    worth = position_worth(log, span)
    said = [s for s in (worth.horizontal_m, worth.vertical_m) if np.isfinite(s)]
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


def position_worth(log: FlightLog, span: Span | None = None) -> PositionWorth:
    """What the log says that its positions are worth, over log times `span` or all of it."""
    receiver, stated = log.receiver, log.accuracy
    horizontal, vertical = stated.horizontal_m, stated.vertical_m
    notes: list[str] = []
    if receiver is not None:
        rows = _within(receiver, span)
        if span is not None and np.isfinite([horizontal, vertical]).any():
            horizontal, vertical = (
                _root_mean_square(value[rows], otherwise)
                for value, otherwise in ((receiver.horizontal_m, horizontal), (receiver.vertical_m, vertical))
            )
        elif not stated.source and (receiver.fix[rows] > FIX_3D).any():
            horizontal = vertical = _by_fix(receiver, rows)
        notes += _fix_notes(receiver, rows, horizontal)
        off = _heights_off(log, receiver, rows)
        notes += _far_notes(log, receiver, *off)
        off_m = _typical_m(off[1], whole=span is None)
        if off_m > (vertical if np.isfinite(vertical) else FIX_SIGMA_M[FIX_3D]):
            assert log.position is not None
            notes.append(
                f"heights of {log.position.source} are {off_m:.1f} m off those of {receiver.source}, as by a barometer:"
                " the vertical sigma is widened by that"
            )
            horizontal = horizontal if np.isfinite(horizontal) else InstrumentSigma().position_bias_m
            vertical = float(np.hypot(vertical, off_m)) if np.isfinite(vertical) else off_m
    return PositionWorth(horizontal_m=horizontal, vertical_m=vertical, notes=tuple(notes))


def _within(receiver: ReceiverSeries, span: Span | None) -> Bools:
    """The rows of some moments, and the nearest before and after them; all where there are none."""
    if span is None or not len(receiver.time_s):
        return np.ones(len(receiver.time_s), dtype=np.bool_)
    first = max(int(np.searchsorted(receiver.time_s, span[0], side="right")) - 1, 0)
    last = min(int(np.searchsorted(receiver.time_s, span[1], side="left")), len(receiver.time_s) - 1)
    rows = np.zeros(len(receiver.time_s), dtype=np.bool_)
    rows[first : last + 1] = True
    return rows


def _root_mean_square(value: Floats, otherwise: float) -> float:
    said = value[np.isfinite(value)]
    return float(np.sqrt(np.mean(said**2))) if len(said) else otherwise


def _by_fix(receiver: ReceiverSeries, rows: Bools) -> float:
    """Of fixes whose accuracy is not stated, by their kind."""
    kinds = receiver.fix[rows]
    worth = np.array([FIX_SIGMA_M[kind] for kind in kinds[kinds >= FIX_3D].tolist()])
    return _root_mean_square(worth, float("nan"))


def _fix_notes(receiver: ReceiverSeries, rows: Bools, horizontal_m: float) -> list[str]:
    """What to say where the kind of fix changes among moments."""
    kinds = receiver.fix[rows]
    names = [(FIX_NAMES[kind], float(np.mean(kinds == kind))) for kind in np.unique(kinds)[::-1].tolist()]
    best, worst = int(kinds.max(initial=0)), int(kinds.min(initial=FIXED))
    if best < FLOAT or best == worst:
        return []
    told = ", ".join(f"{name} {100 * share:.0f} %" for name, share in names)
    worth = f": sigma across {horizontal_m:.2f} m, the root of their mean square" if np.isfinite(horizontal_m) else ""
    return [f"the receiver's fix changes ({told}){worth}"]


def _heights_off(log: FlightLog, receiver: ReceiverSeries, rows: Bools) -> tuple[Floats, Floats]:
    """Log times (k,) and the position's heights minus the receiver's; none where they are the receiver's own."""
    position, none = log.position, (np.empty(0), np.empty(0))
    if position is None or position.source == receiver.source or position.datum != "ellipsoid" or log.takeoff_given:
        return none
    keep = position.valid
    if keep.sum() < 2:
        return none
    stamp, time = position.time_s[keep], receiver.time_s
    told = rows & np.isfinite(receiver.height_m) & (time >= stamp[0]) & (time <= stamp[-1])
    if told.sum() < LEAST_HEIGHTS:
        return none
    return time[told], np.interp(time[told], stamp, position.height_m[keep]) - receiver.height_m[told]


def _typical_m(off_m: Floats, *, whole: bool) -> float:
    """Root mean square; of a whole log, whose moments nobody asked for, that of the many. Zero of none."""
    if not len(off_m):
        return 0.0
    if not whole:
        return float(np.sqrt(np.mean(off_m**2)))
    middle = float(np.median(off_m))
    return float(np.hypot(middle, 1.4826 * np.median(np.abs(off_m - middle))))


def _far_notes(log: FlightLog, receiver: ReceiverSeries, time_s: Floats, off_m: Floats) -> list[str]:
    """What to say of heights that no barometer gets so wrong: before an autopilot knows its home they count from it."""
    far = np.flatnonzero(np.abs(off_m) > FAR_M)
    if not len(far) or log.position is None:
        return []
    return [
        f"heights of {log.position.source} are up to {np.abs(off_m).max():.0f} m off those of {receiver.source},"
        f" between log times {time_s[far[0]]:.1f} and {time_s[far[-1]]:.1f} s: leave that part out, or give `takeoff`"
    ]


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
