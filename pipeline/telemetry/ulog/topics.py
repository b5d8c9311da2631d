"""The topics of a PX4 log (.ulg), read by pyulog (the extra `ulog`): columns of the first instance of each."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from pipeline.telemetry.clocks.boot_clock import IN_ORDER_S, UNKNOWN_BREAK_S, restarts_of

RECEIVED, PRIMARY = 3, "estimator_selector_status"
GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
ROUNDS = 8
"""pyulog reads a whole log once, in pieces of three bytes and more."""
Topic = dict[str, Any]


class _Onwards(io.BufferedReader):
    """A file that is read through once or a few times, not for ever: a wrong length sends pyulog back in circles."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._left = 1000 + ROUNDS * path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file; raises ValueError where more was asked for than the file holds ROUNDS times."""
        found = super().read(size)
        self._left -= 1 + len(found)
        if self._left < 0:
            raise ValueError("a wrong length leads back to where it was read before")
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class PX4Log:
    """What pyulog found.

    topics      of each topic the instance that is used; times of later boots go on after those of earlier ones
    instances   every instance of each topic
    counts      messages per topic
    info, parameters  what the log's head says of vehicle and settings
    notes       dropouts, later boots, and what pyulog complains of, of which there are `complaints`
    """

    topics: dict[str, Topic]
    instances: dict[str, dict[int, Topic]]
    counts: dict[str, int]
    info: dict[str, Any]
    parameters: dict[str, float]
    notes: tuple[str, ...]
    complaints: int


def load_topics(path: Path) -> PX4Log:
    """Every topic of a `.ulg` file. Raises InputFileError where pyulog is not installed or cannot read it."""
    try:
        import pyulog
    except ImportError:
        raise InputFileError(
            where=str(path),
            seen="a PX4 log, and pyulog is not installed",
            expected="the extra `ulog`",
            advice="pip install 'runningfix[ulog]'",
        ) from None
    said = io.StringIO()
    try:
        with _Onwards(path) as file, redirect_stdout(said):  # pyulog prints; standard output is for results
            log = pyulog.ULog(file)
    except Exception as error:  # whatever pyulog trips over in a broken file
        raise InputFileError(
            where=str(path),
            seen=f"cannot be read as a PX4 log ({type(error).__name__}: {error})",
            expected="a whole .ulg file",
            advice="download the log again",
        ) from None
    instances: dict[str, dict[int, Topic]] = {}
    counts: dict[str, int] = {}
    whole = (d for d in log.data_list if "timestamp" in d.data)  # a topic without times is a broken one
    for data in sorted(whole, key=lambda d: d.multi_id):
        counts[data.name] = counts.get(data.name, 0) + len(data.data["timestamp"])
        instances.setdefault(data.name, {}).setdefault(data.multi_id, data.data)
    boots = continue_boots([topic for each in instances.values() for topic in each.values()])
    complaints = said.getvalue().splitlines()
    slow = (f"{len(log.dropouts)} dropouts: the card was too slow for the log",) if log.dropouts else ()
    return PX4Log(
        topics={name: _chosen(name, instances) for name in instances},
        instances=instances,
        counts=counts,
        info=dict(log.msg_info_dict),
        parameters=dict(log.initial_parameters),
        notes=(*slow, *boots, *(f"pyulog: {line}" for line in dict.fromkeys(complaints))),
        complaints=len(complaints),
    )


def _chosen(name: str, instances: dict[str, dict[int, Topic]]) -> Topic:
    """The first instance of a topic; of receivers the first with a 3D fix, of estimators the one that flew mostly."""
    each = instances[name]
    if name in GPS_TOPICS:
        fixed = (t for _, t in sorted(each.items()) if (floats(t, "fix_type") >= RECEIVED).any())
        return next(fixed, each[min(each)])
    if name.startswith("estimator_") and name != PRIMARY and PRIMARY in instances:
        selected = floats(_chosen(PRIMARY, instances), "primary_instance")
        return each.get(int(np.median(selected)) if np.isfinite(selected).any() else 0, each[min(each)])
    return each[min(each)]


def several_receivers(instances: dict[str, dict[int, Topic]]) -> tuple[str, ...]:
    """A note where several receivers have a fix and no topic says which one the estimator follows."""
    name = next((topic for topic in GPS_TOPICS if topic in instances), "")
    fixed = [i for i, topic in sorted(instances.get(name, {}).items()) if (floats(topic, "fix_type") >= RECEIVED).any()]
    if len(fixed) < 2:
        return ()
    said = ", ".join(map(str, fixed))
    return (f"receivers {said} have a fix in {name}; what is said of the receiver is {fixed[0]}'s",)


def continue_boots(topics: list[Topic]) -> list[str]:
    """Moves the times of later boots behind those of earlier ones, in the topics themselves, and says so."""
    seconds = [_numbers(t["timestamp"]) / 1e6 for t in topics]
    falls = [restarts_of(time, IN_ORDER_S) for time in seconds]
    if any(map(len, falls)):  # a topic that comes seldom falls back by less
        falls = [restarts_of(time, 0.0) if not len(fall) else fall for time, fall in zip(seconds, falls, strict=True)]
    parts = [[0, *fall.tolist(), len(time)] for time, fall in zip(seconds, falls, strict=True)]
    boots = max((len(part) - 1 for part in parts), default=0)
    notes, offset_us, end_us = [], 0.0, -np.inf
    for boot in range(boots):
        own = [(t, slice(p[boot], p[boot + 1])) for t, p in zip(topics, parts, strict=True) if len(p) > boot + 1]
        begin_us = min(float(_numbers(t["timestamp"])[rows].min()) for t, rows in own)
        if boot:
            offset_us = end_us + UNKNOWN_BREAK_S * 1e6 - begin_us
            notes.append(
                f"the vehicle started anew at log time {(begin_us + offset_us) / 1e6:.1f} s, an hour after what came"
                f" before as far as anyone knows; from there log time is its boot time + {offset_us / 1e6:.1f} s"
            )
        for topic, rows in own:
            for name in ("timestamp", "timestamp_sample"):
                if boot and name in topic:
                    column = np.array(topic[name], float)
                    column[rows] = np.where(column[rows] > 0, column[rows] + offset_us, 0.0)
                    topic[name] = column
            end_us = max(end_us, float(_numbers(topic["timestamp"])[rows].max()))
    return notes


def topic_time(topic: Topic) -> Floats:
    """Log time (n,); the moment of the sample where the topic tells it from the moment of publishing."""
    name = "timestamp_sample" if np.any(topic.get("timestamp_sample", 0)) else "timestamp"
    return _numbers(topic[name]) / 1e6


def _numbers(column: Any) -> Floats:
    """As float64; a signalling NaN in a broken message is a NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(column, float)


def floats(topic: Topic, *names: str) -> Floats:
    """The first field that is there; NaN where none is."""
    for name in names:
        if name in topic:
            return _numbers(topic[name])
    return np.full(len(topic["timestamp"]), np.nan)


def degrees(topic: Topic, new: str, old: str) -> Floats:
    """A field in degrees, or its predecessor in 1e-7 degrees."""
    return floats(topic, new) if new in topic else floats(topic, old) / 1e7


def metres(topic: Topic, new: str, old: str) -> Floats:
    """A field in metres, or its predecessor in millimetres."""
    return floats(topic, new) if new in topic else floats(topic, old) / 1e3
