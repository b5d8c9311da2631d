"""When frame 0 was, and what UTC it was then."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import InputFileError, UsageError
from pipeline.geometry.geodesy import Geodetic
from pipeline.telemetry.clocks.own_clock import POSIX_FROM_S, counts_from_1970
from pipeline.telemetry.log.flight_log import FlightLog
from pipeline.telemetry.log.missing import missing_position

EVENT_SHARE = 0.25
"""Of a frame's interval: typically events are no further from it where each is a frame."""
UTC_SOURCES = (
    "SYSTEM_TIME (tlog), GPS with week and milliseconds (DataFlash) or vehicle_gps_position (ulog) after a fix"
)


def resolve_start(log: FlightLog, start: float | str, *, where: str) -> float:
    """Log time of frame 0.

    `start` is seconds of log time (above 1e8: POSIX seconds, on the recorder's clock of a `.tlog`, or on that of a log
    that itself counts from 1970), an ISO-8601 time in UTC, or "camera-event": the first exposure that the log knows of.
    `where` names file and key for messages.

    Raises UsageError where `start` cannot be understood, InputFileError where the log cannot answer it.
    """
    if not isinstance(start, str):
        return _from_number(log, float(start), where)
    if start == "camera-event":
        return _from_event(log, where)
    try:
        moment = datetime.fromisoformat(start)
    except ValueError:
        raise UsageError(
            where=where,
            seen=f"start = {start!r}",
            expected='seconds of log time, an ISO-8601 time like "2026-05-27T13:10:00Z", or "camera-event"',
            advice="write a number without quotes, or a full date and time",
        ) from None
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
    return _from_utc(log, moment.timestamp(), where)


def event_times(log: FlightLog, frame: Ints, time_s: Floats) -> Floats | None:
    """Log times (n,) of frames (n,) that the log's camera events tell one by one: event k is frame k.

    None where they do not: there are fewer events than frames, or they are not as far apart as the frames' video times
    `time_s` (n,), as where only the shutter's first press is logged.
    """
    event = log.camera_event_s
    if len(frame) < 2 or int(frame.max()) >= len(event):
        return None
    step = np.diff(time_s)
    wrong = np.abs(np.diff(event[frame]) - step)
    return np.asarray(event[frame]) if np.median(wrong) < EVENT_SHARE * np.median(step) else None


def utc_at(log: FlightLog, log_time_s: float) -> float | None:
    """POSIX seconds (UTC) of a log time, None where the log does not know UTC."""
    return None if log.utc is None else log.utc.other_s(log_time_s)


def log_span(log: FlightLog) -> tuple[float, float]:
    """First and last log time that every series of the log covers.

    Raises InputFileError where there is no position.
    """
    if log.position is None or not log.position.valid.any():
        raise missing_position(log, str(log.path))
    series = [s for s in (log.position, log.attitude, log.gimbal) if s is not None and s.valid.any()]
    begin = max(float(s.time_s[s.valid][0]) for s in series)
    return begin, max(begin, min(float(s.time_s[s.valid][-1]) for s in series))


def first_position(log: FlightLog) -> Geodetic:
    """The first valid position; raises InputFileError where there is none."""
    position = log.position
    if position is None or not position.valid.any():
        raise missing_position(log, str(log.path))
    i = int(np.flatnonzero(position.valid)[0])
    return Geodetic(
        lat_rad=float(position.lat_rad[i]), lon_rad=float(position.lon_rad[i]), height_m=float(position.height_m[i])
    )


def _from_number(log: FlightLog, start: float, where: str) -> float:
    if not np.isfinite(start):
        raise UsageError(where=where, seen=f"start = {start}", expected="a finite number", advice="write the seconds")
    if start <= POSIX_FROM_S or counts_from_1970(log):
        return start
    if log.record_clock is None:
        raise InputFileError(
            where=where,
            seen=f"start = {start:.3f} counts from 1970, but {log.path.name} has no recorder's clock",
            expected="seconds of log time for this kind of log",
            advice="write an ISO-8601 UTC time, or seconds since the vehicle's boot",
        )
    return log.record_clock.log_s(start)


def _from_event(log: FlightLog, where: str) -> float:
    if len(log.camera_event_s) == 0:
        raise InputFileError(
            where=where,
            seen=f'start = "camera-event", but {log.path.name} has no camera event',
            expected="CAMERA_IMAGE_CAPTURED, CAMERA_FEEDBACK or CAMERA_TRIGGER (tlog), CAM or TRIG (DataFlash)",
            advice="give `start` as seconds of log time or as a UTC time",
        )
    return float(log.camera_event_s[0])


def _from_utc(log: FlightLog, posix_s: float, where: str) -> float:
    if log.utc is None:
        raise InputFileError(
            where=where,
            seen=f"{log.path.name} does not know UTC",
            expected=UTC_SOURCES,
            advice="give `start` as seconds of log time (since the vehicle's boot)",
        )
    return log.utc.log_s(posix_s)
