"""Checks of what the flight file alone says, and of what it says of the logs: mounts, places, datums, poses."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pipeline.flight import AUTO, CAMERA_EVENT, CameraSettings, Flight, MountSettings
from pipeline.geometry.geodesy import Geodetic, enu_from_geodetic
from pipeline.stages.checks.doubt import Doubt
from pipeline.stages.inputs.sources import Sources
from pipeline.telemetry import FlightLog, PoseTable, first_position, resolve_start

FAR_M = 50_000.0
"""From the origin to a camera: no flight is so long, and an exchanged place is farther."""
WHOLE_DEG, WHOLE_SHARE = 1.0, 0.012
"""Angles that are whole degrees only when they are read as radians: how near to a whole degree, a typed radian has four
digits or more. Of angles that mean what they say, one in 40 comes so near by chance, three in a mount one in 64,000."""
LEAST_RADIANS = 0.01
"""An angle below it is next to nothing in either unit."""

BURST_S, BESIDE_S, MEANT_S = 5.0, 10.0, 0.2
"""Of a log's camera events one without another so long before it begins a recording; a `start` this near to it means
it, and one that is farther from it than `MEANT_S` is not it. Of typed times the usual mistakes are whole seconds."""


def setting_doubts(flight: Flight, sources: Sources) -> list[Doubt]:
    """Doubts about the settings of a flight, and about what its logs make of them."""
    found = [doubt for camera in flight.cameras for doubt in _radians(flight, camera)]
    for name, log in sources.logs.items():
        camera = flight.camera(name)
        found += _mount_missing(flight, camera, log) + _origin(flight, name, log) + _beside_event(flight, camera, log)
    return found + _datums(flight, sources.logs) + _one_table(flight, sources.tables)


def _radians(flight: Flight, camera: CameraSettings) -> list[Doubt]:
    """A fixed mount whose angles are whole degrees if they are read as radians, and not as they stand."""
    found = []
    for key, mount in (("mount", camera.mount), ("pose", camera.pose)):
        if mount is None or (isinstance(mount, MountSettings) and (mount.gimbal or not mount.given)):
            continue
        typed = [math.degrees(angle) for angle in (mount.roll_rad, mount.pitch_rad, mount.yaw_rad)]
        told = [angle for angle in typed if abs(angle) >= LEAST_RADIANS]
        if told and max(map(abs, told)) <= math.pi + 1e-3 and all(map(_whole_as_radians, told)):
            read = ", ".join(f"{angle:g} for {math.degrees(angle):.0f}" for angle in told)
            found.append(
                Doubt(
                    kind="radians",
                    subject=(camera.name,),
                    where=flight.key(camera.name, key),
                    seen=f"angles that look like radians ({read} degrees)",
                    expected="degrees",
                    advice="write degrees; keep small angles that are meant so",
                )
            )
    return found


def _beside_event(flight: Flight, camera: CameraSettings, log: FlightLog) -> list[Doubt]:
    """A start that is typed, and the log's own camera event seconds beside it."""
    event, where = log.camera_event_s, flight.key(camera.name, "start")
    if camera.start in (None, AUTO, CAMERA_EVENT) or not len(event):
        return []
    assert camera.start is not None
    start = resolve_start(log, camera.start, where=where)
    begins = event[np.diff(event, prepend=-np.inf) > BURST_S]
    away = float(start - begins[np.abs(begins - start).argmin()])
    allowed = max(MEANT_S, 3 * math.hypot(log.camera_event_sigma_s, camera.sigma.get("start_s", 0.0)))
    if np.abs(event - start).min() <= allowed or abs(away) > BESIDE_S:
        return []
    return [
        Doubt(
            kind="start-beside-event",
            subject=(camera.name,),
            where=where,
            seen=f"{abs(away):.2f} s {'after' if away > 0 else 'before'} the camera event that {log.path.name} has of "
            f"that moment ({log.camera_event_source})",
            expected="the moment of frame 0",
            advice='write start = "camera-event", or sigma.start_s with how well the start is known',
        )
    ]


def _whole_as_radians(angle: float) -> bool:
    as_degrees = math.degrees(angle)
    nearest = round(as_degrees / WHOLE_DEG) * WHOLE_DEG
    return nearest != 0 and abs(as_degrees - nearest) <= WHOLE_SHARE and abs(angle - round(angle)) > 1e-9


def _mount_missing(flight: Flight, camera: CameraSettings, log: FlightLog) -> list[Doubt]:
    """No mount where the log tells of a gimbal: the camera would be taken to look along the body."""
    gimbal = log.gimbal
    if camera.mount.given or gimbal is None or not gimbal.valid.any():
        return []
    return [
        Doubt(
            kind="mount-missing",
            subject=(camera.name,),
            where=flight.key(camera.name, "mount"),
            seen=f"missing, and {log.path.name} tells of a gimbal ({gimbal.source})",
            expected="how the camera is turned against the body",
            advice='write mount = "gimbal" for a camera on it, or mount = { pitch_deg = 0 } for one that looks forward',
        )
    ]


def _origin(flight: Flight, name: str, log: FlightLog) -> list[Doubt]:
    """An origin far from where the log was."""
    origin = flight.origin
    if origin is None or log.position is None or not log.position.valid.any():
        return []
    place = first_position(log)
    away_m = _distance_m(place, origin)
    if away_m < FAR_M:
        return []
    swapped = Geodetic(lat_rad=origin.lon_rad, lon_rad=origin.lat_rad, height_m=origin.height_m)
    exchanged = abs(origin.lon_rad) <= np.pi / 2 and _distance_m(place, swapped) < FAR_M
    lat, lon = math.degrees(place.lat_rad), math.degrees(place.lon_rad)
    return [
        Doubt(
            kind="latitude-longitude" if exchanged else "far-origin",
            subject=(name,),
            where=f"{flight.path}: flight.origin",
            seen="latitude and longitude exchanged" if exchanged else f"{away_m / 1000:.0f} km from where {name} began",
            expected=f"a place near {lat:.4f}, {lon:.4f}, where {log.path.name} begins",
            advice="leave origin out to take the first position" if not exchanged else "exchange lat and lon",
            certain=exchanged,
        )
    ]


def _distance_m(place: Geodetic, origin: Geodetic) -> float:
    enu = enu_from_geodetic(np.array(place.lat_rad), np.array(place.lon_rad), np.array(origin.height_m), origin)
    return float(np.linalg.norm(enu))


def _datums(flight: Flight, logs: Mapping[str, FlightLog]) -> list[Doubt]:
    """Heights that count from different surfaces."""
    datums = {name: log.position.datum for name, log in logs.items() if log.position is not None}
    if len(set(datums.values())) < 2:
        return []
    told = ", ".join(f"{name}: {datum}" for name, datum in datums.items())
    return [
        Doubt(
            kind="height-datums",
            subject=tuple(datums),
            where=f"{flight.path}: cameras",
            seen=f"heights that count from different surfaces ({told})",
            expected="one datum for all cameras; they lie up to 100 m apart",
            advice="use logs that give heights above the ellipsoid, or say how high the take-off was",
        )
    ]


def _one_table(flight: Flight, tables: Mapping[str, PoseTable]) -> list[Doubt]:
    """One table of poses for two cameras: both would be at one place."""
    found: list[Doubt] = []
    first: dict[bytes, str] = {}
    for name in tables:
        path = flight.camera(name).telemetry
        assert path is not None
        other = first.setdefault(path.read_bytes(), name)
        if other != name:
            found.append(
                Doubt(
                    kind="one-table-twice",
                    subject=(other, name),
                    where=flight.key(name, "telemetry"),
                    seen=f"the same poses as those of {other}",
                    expected="poses of its own for each camera",
                    advice=f"name the table of {name}",
                    certain=True,
                )
            )
    return found
