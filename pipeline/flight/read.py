"""Flight file -> `Flight`."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from calibration.foundation.errors import UsageError
from calibration.foundation.files import read_bytes
from pipeline.flight.settings import (
    AUTO,
    CAMERA_EVENT,
    CameraSettings,
    Flight,
    MountSettings,
    SolveSettings,
    StillPose,
    TargetSettings,
    Vector,
)
from pipeline.flight.table import Table, nearest
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import TRACKERS, Box
from pipeline.records.problem import METHODS

Item = TypeVar("Item")
ANGLE_SIGMAS = ("attitude_bias", "attitude")
PLAIN_SIGMAS = (
    "position_bias_m",
    "position_m",
    "offset_s",
    "frame_rate",
    "focal",
    "start_s",
    "attitude_tau_s",
    "position_tau_s",
)


def read_flight(path: Path) -> Flight:
    """The flight that `path` describes. Other files are named, not opened.

    Raises InputFileError where the file is missing, UsageError for every mistake in it.
    """
    text = read_bytes(path, expected="a flight file (TOML)")
    try:
        content = tomllib.loads(text.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(
            where=str(path),
            seen=f"not valid TOML: {error}",
            expected="a flight file (TOML, UTF-8)",
            advice="mend that line; text needs quotes, tables look like [cameras.uav1]",
        ) from None
    top = Table(content, f"{path}:")
    head = top.table("flight")
    cameras = _named(top, "cameras", lambda table, name: _camera(table, name, path.parent))
    targets = _named(top, "targets", _target)
    solve = _solve(top.table("solve"))
    top.done()
    if not cameras:
        raise top.refuse("cameras", "at least one [cameras.NAME] table", 'add [cameras.uav1] with calibration = "..."')
    _check_boxes(path, cameras, targets)
    origin, reference, title = _head(head, cameras)
    return Flight(
        path=path,
        title=title or path.resolve().parent.name,
        origin=origin,
        reference_camera=reference,
        cameras=cameras,
        targets=targets,
        solve=solve,
    )


def _named(top: Table, key: str, read: Callable[[Table, str], Item]) -> tuple[Item, ...]:
    table = top.table(key)
    if table is None:
        return ()
    found = []
    for name in table.content:
        inner = table.table(name)
        assert inner is not None
        found.append(read(inner, name))
        inner.done()
    return tuple(found)


def _head(head: Table | None, cameras: tuple[CameraSettings, ...]) -> tuple[Geodetic | None, str, str | None]:
    if head is None:
        return None, cameras[0].name, None
    place = head.table("origin")
    origin = None
    if place is not None:
        lat, lon = place.number("lat", low=-90, high=90), place.number("lon", low=-180, high=180)
        height = place.number("height", 0.0, low=-1000, high=100_000)
        for key, value in (("lat", lat), ("lon", lon)):
            if value is None:
                raise place.refuse(key, "degrees", "write origin = { lat = 28.2, lon = 112.9, height = 60.0 }")
        place.done()
        assert lat is not None
        assert lon is not None
        assert height is not None
        origin = Geodetic.from_degrees(lat, lon, height)
    names = [c.name for c in cameras]
    reference = head.choice("reference_camera", names, names[0])
    title = head.text("title")
    head.done()
    return origin, reference, title


def _camera(table: Table, name: str, folder: Path) -> CameraSettings:
    paths = {key: _path(table, key, folder) for key in ("calibration", "video", "tracks", "telemetry")}
    calibration = paths.pop("calibration")
    if calibration is None:
        raise table.refuse("calibration", "the camera's calibration file", "make one with `runningfix calibrate`")
    pose = _still(table.table("pose"))
    if pose is not None and paths["telemetry"] is not None:
        raise table.refuse("pose", "either pose or telemetry, not both", "remove one of the two")
    offset = table.get("offset_s")
    clock = table.choice("clock", ("auto", "affine", "drift"), "auto")
    return CameraSettings(
        name=name,
        calibration=calibration,
        **paths,
        tracker=table.choice("tracker", TRACKERS, "kcf"),
        dialect=_dialect(table, folder),
        pose=pose,
        start=_start(table),
        frame_rate=table.number("frame_rate", low=0, above=True),
        offset_s=None if offset in (None, "search") else table.number("offset_s"),
        clock=clock,
        mount=_mount(table),
        lever_arm_m=_triple(table.vector("lever_arm_m", 3)),
        sigma=_sigma(table.table("sigma")),
    )


def _path(table: Table, key: str, folder: Path) -> Path | None:
    text = table.text(key)
    return None if text is None else folder / text


def _dialect(table: Table, folder: Path) -> str:
    """The name of one of pymavlink's dialects, or the path of a file of message definitions."""
    text = table.text("dialect") or ""
    return str(folder / text) if text.endswith(".xml") else text


def _triple(values: tuple[float, ...] | None) -> Vector:
    return (values[0], values[1], values[2]) if values else (0.0, 0.0, 0.0)


def _angle(table: Table, key: str) -> float:
    return math.radians(table.number(key, 0.0, low=-360, high=360) or 0.0)


def _still(table: Table | None) -> StillPose | None:
    if table is None:
        return None
    for key in ("east_m", "north_m", "up_m"):
        if key not in table:
            raise table.refuse(key, "metres", "a pose needs east_m, north_m, up_m, yaw_deg, pitch_deg, roll_deg")
    east, north, up = (table.number(key) or 0.0 for key in ("east_m", "north_m", "up_m"))
    pose = StillPose(
        position_enu_m=(east, north, up),
        yaw_rad=_angle(table, "yaw_deg"),
        pitch_rad=_angle(table, "pitch_deg"),
        roll_rad=_angle(table, "roll_deg"),
    )
    table.done()
    return pose


def _mount(table: Table) -> MountSettings:
    if table.content.get("mount") == "gimbal":
        table.get("mount")
        return MountSettings(gimbal=True)
    if isinstance(table.content.get("mount"), str):
        table.get("mount")
        raise table.refuse("mount", '"gimbal" or { roll_deg, pitch_deg, yaw_deg }', 'write mount = "gimbal"')
    inner = table.table("mount")
    if inner is None:
        return MountSettings()
    mount = MountSettings(
        yaw_rad=_angle(inner, "yaw_deg"), pitch_rad=_angle(inner, "pitch_deg"), roll_rad=_angle(inner, "roll_deg")
    )
    inner.done()
    return mount


def _start(table: Table) -> float | str | None:
    value = table.get("start")
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, str):
        if value not in (CAMERA_EVENT, AUTO):
            try:
                datetime.fromisoformat(value)
            except ValueError:
                raise table.refuse(
                    "start",
                    'seconds, an ISO-8601 UTC time, "camera-event" or "auto"',
                    'write start = "2025-06-01T09:30:00Z"',
                ) from None
        return value
    return table.number("start")


def _sigma(table: Table | None) -> dict[str, float]:
    if table is None:
        return {}
    given: dict[str, float | None] = {}
    for name in ANGLE_SIGMAS:
        degrees = table.number(f"{name}_deg", low=0, high=180)
        given[f"{name}_rad"] = None if degrees is None else math.radians(degrees)
    given["pixel_px"] = table.number("pixel", low=0, above=True)
    for name in PLAIN_SIGMAS:
        given[name] = table.number(name, low=0)
    table.done()
    return {name: value for name, value in given.items() if value is not None}


def _target(table: Table, name: str) -> TargetSettings:
    boxes = table.table("boxes")
    found: dict[str, Box] = {}
    if boxes is not None:
        for camera in boxes.content:
            inner = boxes.table(camera)
            assert inner is not None
            found[camera] = _box(inner)
    motion = table.choice("motion", ("auto", "polynomial", "spline"), "auto")
    return TargetSettings(
        name=name, motion=motion, order=table.choice("order", (*range(6), "auto"), "auto"), boxes=found
    )


def _box(table: Table) -> Box:
    frame, sides = table.whole("frame"), table.vector("box", 4)
    if sides is None:
        raise table.refuse("box", "[x, y, width, height] in pixels", "write { frame = 0, box = [612, 340, 24, 18] }")
    if sides[2] < 2 or sides[3] < 2:
        raise table.refuse("box", "a width and a height of at least 2 px", "boxes are [x, y, width, height]")
    table.done()
    return Box(frame=frame or 0, x=sides[0], y=sides[1], width=sides[2], height=sides[3])


def _solve(table: Table | None) -> SolveSettings:
    if table is None:
        return SolveSettings()
    settings = SolveSettings(
        method=table.choice("method", METHODS, "map"),
        frame_rate=table.choice("frame_rate", ("refine", "fixed"), "refine"),
        robust=table.choice("robust", ("huber", "none", "cauchy"), "huber"),
        rate_hz=table.number("rate_hz", 10.0, low=0, high=1000, above=True) or 10.0,
        search_s=table.number("search_s", 120.0, low=0, high=3600, above=True) or 120.0,
    )
    table.done()
    return settings


def _check_boxes(path: Path, cameras: tuple[CameraSettings, ...], targets: tuple[TargetSettings, ...]) -> None:
    names = [c.name for c in cameras]
    for target in targets:
        for camera in target.boxes:
            if camera not in names:
                raise UsageError(
                    where=f"{path}: targets.{target.name}.boxes.{camera}",
                    seen="no such camera",
                    expected="one of " + ", ".join(names),
                    advice=nearest(camera, names),
                )
