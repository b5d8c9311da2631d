"""The topics of a PX4 log (.ulg), read by pyulog (the extra `ulog`): columns of the first instance of each."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError

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


def load_topics(path: Path) -> tuple[dict[str, Topic], dict[str, int], int, list[str]]:
    """First instance of each topic, messages per topic, dropouts, and what pyulog complains of."""
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
    topics: dict[str, Topic] = {}
    counts: dict[str, int] = {}
    whole = (d for d in log.data_list if "timestamp" in d.data)  # a topic without times is a broken one
    for data in sorted(whole, key=lambda d: d.multi_id):
        counts[data.name] = counts.get(data.name, 0) + len(data.data["timestamp"])
        topics.setdefault(data.name, data.data)
    return topics, counts, len(log.dropouts), said.getvalue().splitlines()


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
