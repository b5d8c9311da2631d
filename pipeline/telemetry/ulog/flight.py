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
from pipeline.telemetry.ulog.position import receiver_of, simulated, vehicle_position
from pipeline.telemetry.ulog.resets import reset_notes
from pipeline.telemetry.ulog.topics import load_topics, several_receivers
from pipeline.telemetry.ulog.utc import utc_clock

SYSTEM_NAME = "MAV_SYS_ID"
TRUE_ATTITUDE = "vehicle_attitude_groundtruth"


def read_ulog(path: Path, *, gimbal: int | None = None, progress: Progress = None) -> FlightLog:
    """The flight log in a `.ulg` file; `gimbal` is a gimbal_device_id or an instance.

    Raises InputFileError where pyulog is not installed or cannot read the file, UsageError where there is no such
    gimbal.
    """
    log = load_topics(path)
    topics = log.topics
    if progress is not None:
        progress(1.0)
    position, height_notes = vehicle_position(topics)
    attitude = vehicle_attitude(topics)
    events, event_source, event_notes = camera_events(log.instances)
    accuracy = stated_accuracy(topics)
    utc, utc_notes = utc_clock(topics, log.info)
    mount, gimbals, gimbal_notes = gimbal_attitude(path, log.instances, attitude, gimbal)
    return FlightLog(
        path=path,
        format="ulog",
        system=int(log.parameters[SYSTEM_NAME]) if SYSTEM_NAME in log.parameters else None,
        gimbals=gimbals,
        counts=log.counts,
        corrupt_packets=log.complaints,
        position=position,
        attitude=attitude,
        gimbal=mount,
        camera_event_s=events,
        camera_event_source=event_source,
        utc=utc,
        accuracy=accuracy,
        receiver=receiver_of(topics, accuracy.source),
        truth=simulated(topics, vehicle_attitude(topics, TRUE_ATTITUDE)),
        notes=(
            *log.notes,
            *utc_notes,
            *height_notes,
            *reset_notes(topics),
            *several_receivers(log.instances),
            *gimbal_notes,
            *event_notes,
        ),
    )
