"""UTC out of PX4's topics."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.utc import believed_utc, plausible_utc
from pipeline.telemetry.log.flight_log import (
    ClockModel,
)
from pipeline.telemetry.ulog.columns import GPS_TOPICS, Topic, floats, topic_time

UTC_FLOOR_S = 0.2
BOOT_TIME, BOOT_FLOOR_S = "boot_time_utc_us", 1.0
"""Of the log's head: the system's clock when it started, which a receiver has set to the second."""


def utc_clock(topics: dict[str, Topic], info: dict[str, Any]) -> tuple[ClockModel | None, tuple[str, ...]]:
    """UTC against log time, by a receiver, else by when the log's head says that the vehicle started; None without.

    And what is said of readings that are not used.
    """
    notes: tuple[str, ...] = ()
    for name in GPS_TOPICS:
        topic = topics.get(name)
        if topic is not None and "time_utc_usec" in topic:
            utc, said = believed_utc(name, topic_time(topic), floats(topic, "time_utc_usec") / 1e6)
            notes += said
            found = fit_clock(name, topic_time(topic), utc, floor_s=UTC_FLOOR_S, set_later=True)
            if found is not None:
                return found, notes
    boot_s = np.array([float(info.get(BOOT_TIME, 0)) / 1e6])
    if not plausible_utc(boot_s)[0]:
        return None, notes
    return fit_clock(BOOT_TIME, np.zeros(1), boot_s, floor_s=BOOT_FLOOR_S), notes
