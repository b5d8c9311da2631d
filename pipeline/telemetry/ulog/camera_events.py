"""When the camera exposed, by PX4's topics."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.ulog.topics import Topic, floats, topic_time


def camera_events(topics: dict[str, Topic]) -> tuple[Floats, str]:
    """Log times (k,) of exposures, and which topic says so; trigger and feedback of one number are one exposure."""
    for name in ("camera_capture", "camera_trigger"):
        topic = topics.get(name)
        if topic is None:
            continue
        time, taken = topic_time(topic), np.ones(len(topic["timestamp"]), dtype=bool)
        if "result" in topic:
            taken &= floats(topic, "result") != 0
        if "feedback" in topic and (floats(topic, "feedback") == 1).any():  # when the camera says that it exposed
            taken &= floats(topic, "feedback") == 1
        if taken.any():
            return np.unique(time[taken]), name
    return np.empty(0), ""
