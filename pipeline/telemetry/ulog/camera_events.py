"""When the camera exposed, by PX4's topics."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.ulog.topics import Topic, floats, topic_time


def camera_events(topics: dict[str, Topic]) -> Floats:
    """Log times (k,) of exposures."""
    topic = topics.get("camera_capture", topics.get("camera_trigger"))
    if topic is None:
        return np.empty(0)
    time = topic_time(topic)
    if "result" in topic:
        time = time[floats(topic, "result") != 0]
    return np.unique(time)
