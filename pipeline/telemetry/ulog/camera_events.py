"""When the camera exposed, by PX4's topics."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.ulog.columns import Topic, floats, topic_time


def camera_events(instances: dict[str, dict[int, Topic]]) -> tuple[Floats, str, tuple[str, ...]]:
    """Log times (k,) of exposures of one camera, which topic says so, and notes.

    Trigger and feedback of one number are one exposure; each instance of the topic is a camera's.
    """
    for name in ("camera_capture", "camera_trigger"):
        each = instances.get(name, {})
        if not each:
            continue
        first, topic = min(each), each[min(each)]
        time, taken = topic_time(topic), np.ones(len(topic["timestamp"]), dtype=bool)
        if "result" in topic:
            taken &= floats(topic, "result") != 0
        if "feedback" in topic and (floats(topic, "feedback") == 1).any():  # when the camera says that it exposed
            taken &= floats(topic, "feedback") == 1
        if taken.any():
            said = f"{len(each)} cameras speak in {name}; instance {first} is used"
            return np.unique(time[taken]), name, (said,) if len(each) > 1 else ()
    return np.empty(0), "", ()
