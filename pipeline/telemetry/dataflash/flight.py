"""From DataFlash messages to a FlightLog."""

from __future__ import annotations

from pipeline.telemetry.dataflash.accuracy import stated_accuracy
from pipeline.telemetry.dataflash.attitude import vehicle_attitude
from pipeline.telemetry.dataflash.boots import continued
from pipeline.telemetry.dataflash.camera_events import camera_events
from pipeline.telemetry.dataflash.gimbal import gimbal_attitude
from pipeline.telemetry.dataflash.parameters import system_of
from pipeline.telemetry.dataflash.position import receiver_of, simulated, vehicle_position, vehicle_undulation
from pipeline.telemetry.dataflash.utc import utc_clock
from pipeline.telemetry.log.flight_log import (
    FlightLog,
)
from pipeline.telemetry.log.tables import RawLog


def dataflash_flight(raw: RawLog, *, gimbal: int | None = None) -> FlightLog:
    """What a DataFlash log says of its vehicle."""
    raw = continued(raw)
    undulation = vehicle_undulation(raw)
    position, height_notes = vehicle_position(raw, undulation)
    attitude = vehicle_attitude(raw)
    mount, gimbals, gimbal_notes = gimbal_attitude(raw, attitude, gimbal)
    events, source, event_notes = camera_events(raw)
    utc, utc_notes = utc_clock(raw)
    return FlightLog(
        path=raw.path,
        format=raw.format,
        counts=raw.counts,
        corrupt_packets=raw.corrupt_packets,
        position=position,
        attitude=attitude,
        gimbal=mount,
        gimbals=gimbals,
        system=system_of(raw),
        camera_event_s=events,
        camera_event_source=source,
        utc=utc,
        accuracy=stated_accuracy(raw),
        receiver=receiver_of(raw, undulation),
        truth=simulated(raw, undulation),
        notes=(*raw.notes, *utc_notes, *height_notes, *gimbal_notes, *event_notes),
    )
