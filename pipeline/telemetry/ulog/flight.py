"""From PX4's topics to a FlightLog. Times are microseconds since boot."""

from __future__ import annotations

from pathlib import Path

from pipeline.telemetry.log.flight_log import (
    FlightLog,
)
from pipeline.telemetry.log.tables import Progress
from pipeline.telemetry.ulog.accuracy import stated_accuracy
from pipeline.telemetry.ulog.attitude import gimbal_attitude, vehicle_attitude
from pipeline.telemetry.ulog.camera_events import camera_events
from pipeline.telemetry.ulog.position import vehicle_position
from pipeline.telemetry.ulog.topics import load_topics
from pipeline.telemetry.ulog.utc import utc_clock


def read_ulog(path: Path, *, progress: Progress = None) -> FlightLog:
    """The flight log in a `.ulg` file.

    Raises InputFileError where pyulog is not installed or cannot read the file.
    """
    topics, counts, dropouts, complaints = load_topics(path)
    if progress is not None:
        progress(1.0)
    slow = (f"{dropouts} dropouts: the card was too slow for the log",) if dropouts else ()
    return FlightLog(
        path=path,
        format="ulog",
        counts=counts,
        corrupt_packets=len(complaints),
        position=vehicle_position(topics),
        attitude=vehicle_attitude(topics),
        gimbal=gimbal_attitude(topics),
        camera_event_s=camera_events(topics),
        camera_event_source="camera_capture" if "camera_capture" in topics else "camera_trigger",
        utc=utc_clock(topics),
        accuracy=stated_accuracy(topics),
        notes=(*slow, *(f"pyulog: {line}" for line in dict.fromkeys(complaints))),
    )
