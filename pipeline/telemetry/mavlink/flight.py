"""From MAVLink messages to a FlightLog."""

from __future__ import annotations

from dataclasses import replace

from pipeline.telemetry.clocks.boot_clock import boot_clock
from pipeline.telemetry.log.flight_log import (
    FlightLog,
)
from pipeline.telemetry.log.tables import RawLog
from pipeline.telemetry.mavlink.accuracy import stated_accuracy
from pipeline.telemetry.mavlink.attitude import has_attitude, vehicle_attitude
from pipeline.telemetry.mavlink.camera_events import camera_events
from pipeline.telemetry.mavlink.gimbal import gimbal_attitude
from pipeline.telemetry.mavlink.position import receiver_of, simulated, vehicle_position, vehicle_undulation
from pipeline.telemetry.mavlink.times import utc_clock
from pipeline.telemetry.mavlink.vehicle import (
    POSITION_MESSAGES,
    Vehicle,
    boot_readings,
    choose_vehicle,
    clock_notes,
    systems_of,
    unix_readings,
)


def mavlink_flight(raw: RawLog, *, system: int | None = None, gimbal: int | None = None) -> FlightLog:
    """What one vehicle's MAVLink messages say; of several, the one with most positions unless `system` names it.

    `gimbal` names one of several gimbals by its device or component.

    Raises InputFileError where no autopilot (or not the named one) speaks in the log, UsageError where the gimbal does
    not.
    """
    chosen, notes = choose_vehicle(raw, system)
    place, boot_s, record_s = boot_readings(raw, chosen)
    clock = boot_clock(place, boot_s, record_s, unix_readings(raw, chosen, place))
    vehicle = Vehicle(raw=raw, system=chosen[0], component=chosen[1], clock=clock)
    notes += clock_notes(vehicle.clock)
    utc, utc_notes = utc_clock(vehicle)
    undulation = vehicle_undulation(vehicle)
    position, height_notes = vehicle_position(vehicle, undulation)
    receiver, truth, accuracy = receiver_of(vehicle, undulation), simulated(vehicle), stated_accuracy(vehicle)
    systems = systems_of(raw)
    spent = [name for name in POSITION_MESSAGES if name != "AHRS2" or has_attitude(vehicle)]
    raw = raw.without((*spent, "SYSTEM_TIME"))  # of a long log they are as large as what is made of them
    vehicle = replace(vehicle, raw=raw)
    attitude = vehicle_attitude(vehicle)
    mount, gimbals, gimbal_notes = gimbal_attitude(vehicle, attitude, gimbal)
    events, event_source, event_notes = camera_events(vehicle, utc)
    return FlightLog(
        path=raw.path,
        format=raw.format,
        system=chosen[0],
        component=chosen[1],
        counts=raw.counts,
        corrupt_packets=raw.corrupt_packets,
        position=position,
        attitude=attitude,
        gimbal=mount,
        systems=systems,
        gimbals=gimbals,
        camera_event_s=events,
        camera_event_source=event_source,
        utc=utc,
        record_clock=vehicle.clock.record,
        accuracy=accuracy,
        receiver=receiver,
        truth=truth,
        notes=(*raw.notes, *notes, *utc_notes, *height_notes, *gimbal_notes, *event_notes),
    )
