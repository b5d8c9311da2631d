"""UTC out of PX4's topics."""

from __future__ import annotations

import numpy as np

from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import plausible_utc
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.ulog.topics import GPS_TOPICS, Topic, floats, topic_time

UTC_FLOOR_S = 0.2


def utc_clock(topics: dict[str, Topic]) -> ClockModel | None:
    """UTC against log time; None where the log does not know it."""
    for name in GPS_TOPICS:
        topic = topics.get(name)
        if topic is not None and "time_utc_usec" in topic:
            utc = floats(topic, "time_utc_usec") / 1e6
            found = fit_clock(name, topic_time(topic), np.where(plausible_utc(utc), utc, np.nan), floor_s=UTC_FLOOR_S)
            if found is not None:
                return found
    return None
