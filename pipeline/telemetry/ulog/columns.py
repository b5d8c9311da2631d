"""One topic of a PX4 log as columns: a field of the name that this firmware has for it, in SI."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats

GPS_TOPICS = ("vehicle_gps_position", "sensor_gps")
Topic = dict[str, Any]


def topic_time(topic: Topic) -> Floats:
    """Log time (n,); the moment of the sample where the topic tells it from the moment of publishing."""
    name = "timestamp_sample" if np.any(topic.get("timestamp_sample", 0)) else "timestamp"
    return numbers(topic[name]) / 1e6


def numbers(column: Any) -> Floats:
    """As float64; a signalling NaN in a broken message is a NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(column, float)


def floats(topic: Topic, *names: str) -> Floats:
    """The first field that is there; NaN where none is."""
    for name in names:
        if name in topic:
            return numbers(topic[name])
    return np.full(len(topic["timestamp"]), np.nan)


def degrees(topic: Topic, new: str, old: str) -> Floats:
    """A field in degrees, or its predecessor in 1e-7 degrees."""
    return floats(topic, new) if new in topic else floats(topic, old) / 1e7


def metres(topic: Topic, new: str, old: str) -> Floats:
    """A field in metres, or its predecessor in millimetres."""
    return floats(topic, new) if new in topic else floats(topic, old) / 1e3
