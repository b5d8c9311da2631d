"""Minutes out of a long log, without reading the rest.

A log's clocks, heights and instruments are told by all of it. Of a long one they are told as well by its beginning and
by pieces evenly over it, a few hundredths of its bytes; between pieces whose times are known the wanted minutes are
found by halving. What such a reading holds of the wanted minutes is what the whole reading holds of them, bit for bit,
wherever a message says its own time; what is a median or a fit over the log (UTC, the recorder's clock, undulation,
stated accuracy) is one over the sample. Which vehicle and which messages are used is decided by the sample too, and
where that could turn out otherwise, or a clock is not steady, there is no excerpt: all of the log is to be read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import InputFileError, UsageError
from pipeline.telemetry.clocks.boot_clock import IN_ORDER_S, REBOOT_S, restarts_of
from pipeline.telemetry.clocks.clock_model import MAX_DRIFT
from pipeline.telemetry.log.byte_ranges import Pieces, bytes_in, joined, sampled
from pipeline.telemetry.log.flight_log import FlightLog
from pipeline.telemetry.log.tables import RawLog
from pipeline.telemetry.video_start.log_time import resolve_start

HEAD_BYTES = 1 << 20
"""Read of every log's beginning: definitions, parameters, the first position; more where that comes later."""
LARGEST_SHARE = 0.5
"""Of a file: to read more of it in pieces saves nothing."""
EDGE_S = REBOOT_S + 5.0
"""Read on both sides of an excerpt: a message this much later or earlier than those around it is not one of them."""
LARGEST_LATE_S = 5.0
"""By which the recorder's clock and the vehicle's may disagree from one piece to the next, beside their drift."""
FIRST_READINGS = 5
STEP_BYTES = 1 << 15
FINE_BYTES = 1 << 18


@dataclass(frozen=True, kw_only=True)
class Excerpt:
    """The part of a log around a moment.

    start    the moment, as for `resolve_start`: seconds of log time, above 1e8 POSIX seconds on the recorder's clock,
             or an ISO-8601 time in UTC; not "camera-event": which one is the first only the whole log tells
    before_s, after_s  how far the part reaches to both sides of it, seconds
    """

    start: float | str
    before_s: float
    after_s: float

    def __post_init__(self) -> None:
        if self.start == "camera-event":
            raise ValueError("an excerpt's start is a time; the first camera event is known when all of a log is read")


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """Log times in the order of the file: `place` (n,) about in bytes, `time_s` (n,), `record_s` (n,) the recorder's
    time beside it, NaN where there is none."""

    place: Ints
    time_s: Floats
    record_s: Floats


@dataclass(frozen=True, kw_only=True)
class PieceReader:
    """How a format is read in pieces.

    size      of the file, bytes
    read      messages of pieces, and `glance` those that have readings, as far as they are understood at once
    flight    what they say
    readings  their times, of the vehicle that the log is of
    doubtful  whether what was decided of the log could turn out otherwise if more were read
    """

    size: int
    read: Callable[[Pieces], RawLog]
    glance: Callable[[Pieces], RawLog]
    flight: Callable[[RawLog], FlightLog]
    readings: Callable[[RawLog, FlightLog], Readings]
    doubtful: Callable[[RawLog, FlightLog], bool]


def read_excerpts(reader: PieceReader, excerpts: tuple[Excerpt, ...]) -> FlightLog | None:
    """A log of which the time from the first excerpt's begin to the last one's end is whole, the rest a sample.

    None where the log has to be read whole: its clocks are not steady, what is in it is not clear from a sample, an
    excerpt's start cannot be told, or the excerpts are most of it.
    """
    try:
        return _excerpt(reader, excerpts)
    except (InputFileError, UsageError):  # the whole log answers, or says better what is missing
        return None


def _excerpt(reader: PieceReader, excerpts: tuple[Excerpt, ...]) -> FlightLog | None:
    found = _sample(reader)
    if found is None:
        return None
    pieces, readings, log = found
    begin_s, end_s = _span(log, excerpts)
    wanted = _bytes_of(reader, log, pieces, readings, (begin_s - EDGE_S, end_s + EDGE_S))
    pieces = joined((*pieces, wanted))
    if bytes_in(pieces) > LARGEST_SHARE * reader.size:
        return None
    raw = reader.read(pieces)
    log = reader.flight(raw)
    if reader.doubtful(raw, log) or not _steady(reader.readings(raw, log), pieces):
        return None
    return replace(log, excerpt_s=(begin_s, end_s), bytes_read=raw.bytes_read)


def _sample(reader: PieceReader) -> tuple[Pieces, Readings, FlightLog] | None:
    """Pieces evenly over the log, the beginning up to the first position, and what they say."""
    head = HEAD_BYTES
    while bytes_in(pieces := sampled(reader.size, head)) <= LARGEST_SHARE * reader.size:
        raw = reader.read(pieces)
        log = reader.flight(raw)
        readings = reader.readings(raw, log)
        if log.position is None or reader.doubtful(raw, log) or not _steady(readings, pieces):
            return None
        first_fix_s = log.position.time_s[log.position.valid][:1]
        in_head = readings.time_s[readings.place < pieces[0][1]]
        if len(first_fix_s) and len(in_head) and first_fix_s[0] <= in_head[-1]:
            return pieces, readings, log
        head *= 4
    return None


def _span(log: FlightLog, excerpts: tuple[Excerpt, ...]) -> tuple[float, float]:
    start = [resolve_start(log, e.start, where=str(log.path)) for e in excerpts]
    begins = [s - e.before_s for s, e in zip(start, excerpts, strict=True)]
    return min(begins), max(s + e.after_s for s, e in zip(start, excerpts, strict=True))


def _steady(readings: Readings, pieces: Pieces) -> bool:
    """Whether time goes on from piece to piece, and the vehicle's clock never started anew: not even between them."""
    if len(restarts_of(readings.time_s, IN_ORDER_S)):
        return False
    parts = [part for _, part in _parts(readings, pieces)]
    if not parts:
        return False
    time = np.array([np.median(readings.time_s[part]) for part in parts])
    late = np.array([np.median(readings.record_s[part] - readings.time_s[part]) for part in parts])
    drifted = np.abs(np.diff(late)) > LARGEST_LATE_S + MAX_DRIFT * np.abs(np.diff(time))  # never where NaN
    return bool(np.all(np.diff(time) > 0) and not drifted.any())


def _parts(readings: Readings, pieces: Pieces) -> list[tuple[int, slice]]:
    """First byte of each piece that has readings, and which they are."""
    begins = [begin for begin, _ in pieces]
    first = [*np.searchsorted(readings.place, begins).tolist(), len(readings.place)]
    return [(begin, slice(a, b)) for begin, (a, b) in zip(begins, pairwise(first), strict=True) if b > a]


def _bytes_of(
    reader: PieceReader, log: FlightLog, pieces: Pieces, readings: Readings, span_s: tuple[float, float]
) -> tuple[int, int]:
    """Where in the file the log time from span_s[0] to span_s[1] is, to FINE_BYTES on both sides."""
    knots = [(place, _early(readings.time_s[part])) for place, part in _parts(readings, pieces)]

    def time_at(place: int) -> float:
        """The log time where the file has come to `place`."""
        step = STEP_BYTES
        while place < reader.size:
            piece = (place, min(place + step, reader.size))
            found = reader.readings(reader.glance((piece,)), log).time_s
            if len(found):
                return _early(found)
            place, step = place + step, 2 * step
        return np.inf

    def narrowed(bound_s: float) -> tuple[int, int]:
        """Two places between which the log comes to `bound_s`."""
        low = max((place for place, time in knots if time < bound_s), default=0)
        high = min((place for place, time in knots if time >= bound_s), default=reader.size)
        while high - low > FINE_BYTES:
            middle = (low + high) // 2
            low, high = (middle, high) if time_at(middle) < bound_s else (low, middle)
        return low, high

    return narrowed(span_s[0])[0], narrowed(span_s[1])[1]


def _early(time_s: Floats) -> float:
    """The time at which readings begin, safe from a single wrong one."""
    return float(np.median(time_s[:FIRST_READINGS]))
