"""What a PX4 log says its instruments are worth."""

from __future__ import annotations

from pipeline.telemetry.log.flight_log import (
    Accuracy,
)
from pipeline.telemetry.log.series import median_of
from pipeline.telemetry.ulog.columns import GPS_TOPICS, Topic, floats


def stated_accuracy(topics: dict[str, Topic]) -> Accuracy:
    """The sigmas that the log states; NaN where it does not."""
    for name in ("vehicle_global_position", *GPS_TOPICS, "vehicle_local_position"):
        topic = topics.get(name)
        if topic is not None and "eph" in topic:
            return Accuracy(
                horizontal_m=median_of(floats(topic, "eph"), 100.0),
                vertical_m=median_of(floats(topic, "epv"), 100.0),
                source=name,
            )
    topic = topics.get("estimator_status")
    if topic is None or "pos_horiz_accuracy" not in topic:
        return Accuracy()
    horizontal, vertical = (median_of(floats(topic, f"pos_{axis}_accuracy"), 100.0) for axis in ("horiz", "vert"))
    return Accuracy(horizontal_m=horizontal, vertical_m=vertical, source="estimator_status")
