"""Whose log is it: which vehicle and gimbal a camera is on, and what its heights count from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.foundation.errors import UsageError
from pipeline.flight import CameraSettings, Flight
from pipeline.telemetry import FlightLog


def left_over(flight: Flight, camera: CameraSettings, log: FlightLog) -> int:
    """The vehicle of a log of several that is this camera's because the others are asked for by the other cameras.

    Raises UsageError where more than one is left.
    """
    others = {c.system for c in flight.cameras if c.telemetry == camera.telemetry and c.name != camera.name}
    left = [system for system in log.systems if system not in others]
    unasked = [c.name for c in flight.cameras if c.telemetry == camera.telemetry and c.system is None]
    if len(left) == 1 and unasked == [camera.name]:
        return left[0]
    names = ", ".join(map(str, log.systems))
    raise UsageError(
        where=flight.key(camera.name, "telemetry"),
        seen=f"{log.path.name} carries several vehicles (systems {names}), and nothing says on which the camera is",
        expected="one vehicle for each camera",
        advice=f"write system = {log.systems[0]} (or another of {names}) beside telemetry",
    )


def check_vehicles(flight: Flight, logs: Mapping[str, FlightLog]) -> None:
    """Raises UsageError where a log is another vehicle's than asked for, a gimbal is not named, or two share one."""
    for name, log in logs.items():
        camera = flight.camera(name)
        if camera.system is not None and log.system is not None and camera.system != log.system:
            raise UsageError(
                where=flight.key(name, "system"),
                seen=f"system = {camera.system}, but {log.path.name} is of system {log.system}",
                expected="the vehicle that the log is of",
                advice=f"write system = {log.system}, or name the other vehicle's log",
            )
        if camera.mount.gimbal and camera.gimbal is None and log.gimbals:
            names = ", ".join(map(str, log.gimbals))
            raise UsageError(
                where=flight.key(name, "mount"),
                seen=f"{log.path.name} tells of several gimbals that look different ways ({names})",
                expected="one gimbal for the camera",
                advice=f"write gimbal = {log.gimbals[0]} (or another of {names}) beside mount",
            )
    seen: list[str] = []
    for name in logs:
        for other in seen:
            if _same_vehicle(logs[name], logs[other]) and not _asked_apart(flight.camera(name), flight.camera(other)):
                raise _one_vehicle(flight, name, other, logs)
        seen.append(name)


def _same_vehicle(first: FlightLog, second: FlightLog) -> bool:
    """Whether two logs tell of the same flight of the same vehicle: the same file, or a copy of it."""
    if first is second:
        return True
    if first.path == second.path:
        return first.system == second.system
    a, b = first.position, second.position
    if a is None or b is None or first.format != second.format or dict(first.counts) != dict(second.counts):
        return False
    if len(a.time_s) != len(b.time_s) or not a.valid.any():
        return False
    return bool(
        np.array_equal(a.lat_rad, b.lat_rad, equal_nan=True) and np.array_equal(a.time_s, b.time_s, equal_nan=True)
    )


def _asked_apart(first: CameraSettings, second: CameraSettings) -> bool:
    """Whether a person said that both are on one vehicle: both name it, or each its gimbal."""
    both = first.system is not None and second.system is not None
    return both or (first.gimbal is not None and second.gimbal is not None and first.gimbal != second.gimbal)


def _one_vehicle(flight: Flight, name: str, other: str, logs: Mapping[str, FlightLog]) -> UsageError:
    log = logs[name]
    more = [system for system in log.systems if system != log.system]
    which = f"system {log.system}" if log.system is not None else "one vehicle"
    advice = f"if both cameras are on it, write system = {log.system or 1} at both"
    if more:
        advice = f"write system = {more[0]} at the camera that is on the other vehicle; " + advice
    return UsageError(
        where=flight.key(name, "telemetry"),
        seen=f"{other} and {name} both come to {which} of {log.path.name}",
        expected="a vehicle of its own for each camera",
        advice=advice + "; else name the other vehicle's log",
    )


def check_datums(flight: Flight, logs: Mapping[str, FlightLog]) -> None:
    """Raises UsageError where heights above home would meet heights that count from elsewhere."""
    placed = [c.name for c in flight.cameras if c.telemetry is not None or c.pose is not None]
    for name, log in logs.items():
        if log.position is None or log.position.datum != "home":
            continue
        if len(placed) > 1 or flight.origin is not None:
            others = ", ".join(c for c in placed if c != name) or "the origin"
            raise UsageError(
                where=flight.key(name, "telemetry"),
                seen=f"{log.path.name} gives heights above its take-off place only, and {others} count from elsewhere",
                expected="heights of one datum",
                advice='write takeoff = { height = 61.0, datum = "msl" } (or "ellipsoid"): how high the take-off was',
            )


def gimbal_left_out(camera: CameraSettings, log: FlightLog) -> tuple[str, ...]:
    """A note where the log tells of a gimbal, and the flight file fixes the camera in the body."""
    gimbal = log.gimbal
    if camera.mount.gimbal or gimbal is None or gimbal.valid.sum() < 2:
        return ()
    return (
        f"the log tells of a gimbal ({gimbal.source}), and the camera is taken as fixed in the body: if it hangs in the"
        ' gimbal write mount = "gimbal", and what `boresight` finds as mount_correction',
    )
