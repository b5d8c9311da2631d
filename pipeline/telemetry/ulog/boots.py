"""Several boots in one PX4 log are several flights: times of later ones go on behind those of earlier ones."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import median
from pipeline.telemetry.clocks.boot_clock import IN_ORDER_S, UNKNOWN_BREAK_S, restarts_of
from pipeline.telemetry.clocks.leaps import APART_S
from pipeline.telemetry.clocks.utc import plausible_utc
from pipeline.telemetry.ulog.columns import GPS_TOPICS, Topic, floats, numbers
from pipeline.telemetry.ulog.recordings import Instances, Recording

TIMES = ("timestamp", "timestamp_sample")


def joined(recordings: list[Recording]) -> tuple[Instances, list[str]]:
    """The topics of all recordings, each behind the one before, and a note for each boot and each doubt."""
    found: Instances = {}
    notes: list[str] = []
    offset_s, end_s, late_s = 0.0, -np.inf, np.nan
    for recording in recordings:
        topics = [topic for each in recording.instances.values() for topic in each.values()]
        told = [numbers(t["timestamp"]) / 1e6 for t in topics if len(t["timestamp"])]
        if not told:
            continue
        late = _utc_late_s(recording.instances)
        if np.isfinite(end_s):
            offset_s, said = _offset_s(min(float(t.min()) for t in told), offset_s, end_s, late - late_s)
            notes += [said] if said else []
            _move(topics, offset_s)
        notes += _continue_falls(topics)
        end_s = max(float(numbers(t["timestamp"]).max()) / 1e6 for t in topics if len(t["timestamp"]))
        late_s = late if np.isfinite(late) else late_s
        for name, each in recording.instances.items():
            for instance, topic in each.items():
                mine = found.setdefault(name, {})
                mine[instance] = _and_then(mine[instance], topic) if instance in mine else topic
    return found, notes


def _offset_s(begin_s: float, before_s: float, end_s: float, apart_s: float) -> tuple[float, str]:
    """Log time minus the clock of a recording that begins at `begin_s` by it, and what to say.

    `before_s` and `end_s` are the offset and the end, in log time, of the recording before it; `apart_s` is UTC minus
    boot time here less that there, NaN where no receiver tells it.
    """
    goes_on = begin_s + before_s > end_s
    if goes_on and abs(apart_s) <= APART_S:
        return before_s, ""
    if goes_on and not np.isfinite(apart_s):
        return before_s, (
            f"another log begins in the file at log time {begin_s + before_s:.1f} s, {begin_s + before_s - end_s:.1f} s"
            " after what came before by its own clock: no receiver's time tells whether the vehicle started anew"
            " between, and it is read as if it had not"
        )
    by_gps = bool(begin_s + before_s + apart_s > end_s)
    offset_s = before_s + apart_s if by_gps else end_s + UNKNOWN_BREAK_S - begin_s
    return offset_s, _started_anew(begin_s + offset_s, offset_s, by_gps=by_gps)


def _started_anew(log_s: float, offset_s: float, *, by_gps: bool = False) -> str:
    how = "by GPS time" if by_gps else "an hour after what came before as far as anyone knows"
    return (
        f"the vehicle started anew at log time {log_s:.1f} s, {how}; from there log time is its boot time +"
        f" {offset_s:.1f} s"
    )


def _utc_late_s(instances: Instances) -> float:
    """UTC minus boot time by a receiver; NaN where none tells it."""
    for name in GPS_TOPICS:
        for topic in instances.get(name, {}).values():
            utc = floats(topic, "time_utc_usec") / 1e6
            late = (utc - numbers(topic["timestamp"]) / 1e6)[plausible_utc(utc)]
            if len(late):
                return median(late)
    return float("nan")


def _move(topics: list[Topic], offset_s: float) -> None:
    """Adds to every time but zero, in the topics themselves."""
    for topic in topics:
        for name in TIMES:
            if name in topic:
                time = numbers(topic[name])
                topic[name] = np.where(time > 0, time + 1e6 * offset_s, 0.0)


def _and_then(first: Topic, second: Topic) -> Topic:
    """The fields that both have, one behind the other."""
    return {name: np.concatenate([first[name], second[name]]) for name in first if name in second}


def _continue_falls(topics: list[Topic]) -> list[str]:
    """Moves the times of later boots behind those of earlier ones, in the topics themselves, and says so."""
    seconds = [numbers(t["timestamp"]) / 1e6 for t in topics]
    falls = [restarts_of(time, IN_ORDER_S) for time in seconds]
    if any(map(len, falls)):  # a topic that comes seldom falls back by less
        falls = [restarts_of(time, 0.0) if not len(fall) else fall for time, fall in zip(seconds, falls, strict=True)]
    parts = [[0, *fall.tolist(), len(time)] for time, fall in zip(seconds, falls, strict=True)]
    boots = max((len(part) - 1 for part in parts), default=0)
    notes, offset_us, end_us = [], 0.0, -np.inf
    for boot in range(boots):
        own = [(t, slice(p[boot], p[boot + 1])) for t, p in zip(topics, parts, strict=True) if len(p) > boot + 1]
        begin_us = min(float(numbers(t["timestamp"])[rows].min()) for t, rows in own)
        if boot:
            offset_us = end_us + UNKNOWN_BREAK_S * 1e6 - begin_us
            notes.append(_started_anew((begin_us + offset_us) / 1e6, offset_us / 1e6))
        for topic, rows in own:
            for name in TIMES:
                if boot and name in topic:
                    column = np.array(topic[name], float)
                    column[rows] = np.where(column[rows] > 0, column[rows] + offset_us, 0.0)
                    topic[name] = column
            end_us = max(end_us, float(numbers(topic["timestamp"])[rows].max()))
    return notes
