"""The sections of a flight file, a row for each key: what may stand there and what it becomes."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from pipeline.flight import keys
from pipeline.flight.keys import Key
from pipeline.flight.settings import (
    CameraSettings,
    GroundSettings,
    LandmarkSettings,
    Mark,
    MountSettings,
    StillPose,
    TakeoffSettings,
    TargetSettings,
    VideoArea,
)
from pipeline.flight.table import Table
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import TRACKERS, Box
from pipeline.records.problem import METHODS

LOWEST_HZ, HIGHEST_HZ = 0.01, 100_000.0
"""Frame rates of a camera: a frame in 100 s is the slowest time lapse, a high-speed camera the fastest."""

LONGEST_READOUT_S = 0.2
"""Of a rolling shutter: sensors take 5 to 40 ms; a number of milliseconds is refused."""

ORIGIN = "write origin = { lat = 28.2, lon = 112.9, height = 60.0 }"
ORIGIN_KEYS = (
    Key("lat", keys.needed_number(ORIGIN, expected="degrees", low=-90, high=90)),
    Key("lon", keys.needed_number(ORIGIN, expected="degrees", low=-180, high=180)),
    Key("height", keys.number(0.0, low=-1000, high=100_000)),
)
FLIGHT_KEYS = (
    Key("origin", keys.section(ORIGIN_KEYS, lambda lat, lon, height: Geodetic.from_degrees(lat, lon, height))),
    Key("reference_camera", keys.text()),
    Key("title", keys.text()),
)

POSE = "a pose needs east_m, north_m, up_m, yaw_deg, pitch_deg, roll_deg"
METRES = keys.needed_number(POSE, expected="metres", low=-1e7, high=1e7)
POSE_KEYS = (
    *(Key(axis, METRES) for axis in ("east_m", "north_m", "up_m")),
    *(Key(f"{angle}_deg", keys.degrees(), f"{angle}_rad") for angle in ("yaw", "pitch", "roll")),
)  # fmt: skip
MOUNT_KEYS = tuple(Key(f"{angle}_deg", keys.degrees(), f"{angle}_rad") for angle in ("roll", "pitch", "yaw"))


def still_pose(east_m: float, north_m: float, up_m: float, **angles: float) -> StillPose:
    """A camera that stands still."""
    return StillPose(position_enu_m=(east_m, north_m, up_m), **angles)


def mount(table: Table, key: str, folder: Path) -> MountSettings:
    """Fixed angles, or "gimbal"."""
    value = table.content.get(key)
    if value == "gimbal":
        table.get(key)
        return MountSettings(gimbal=True, given=True)
    if isinstance(value, str):
        table.get(key)
        raise table.refuse(key, '"gimbal" or { roll_deg, pitch_deg, yaw_deg }', 'write mount = "gimbal"')
    found: MountSettings = keys.section(MOUNT_KEYS, _fixed_mount, MountSettings())(table, key, folder)
    return found


def _fixed_mount(roll_rad: float, pitch_rad: float, yaw_rad: float) -> MountSettings:
    return MountSettings(roll_rad=roll_rad, pitch_rad=pitch_rad, yaw_rad=yaw_rad, given=True)


TAKEOFF_KEYS = (
    Key(
        "height",
        keys.needed_number(
            'write takeoff = { height = 61.0, datum = "msl" }', expected="metres", low=-1000, high=100_000
        ),
        "height_m",
    ),
    Key("datum", keys.choice(("ellipsoid", "msl"), "ellipsoid")),
)


def video_area(table: Table, key: str, folder: Path) -> VideoArea | None:
    """`{ crop = [x, y, width, height], of = [width, height] }`, in pixels of the calibrated picture."""
    inner = table.table(key)
    if inner is None:
        return None
    crop, of = inner.vector("crop", 4), inner.vector("of", 2)
    for name, value in (("crop", crop), ("of", of)):
        if value is None:
            raise inner.refuse(
                name,
                "crop = [x, y, width, height] and of = [width, height] of the calibrated picture",
                "write video_area = { crop = [0, 270, 3840, 2160], of = [3840, 2700] }",
            )
    assert crop is not None
    assert of is not None
    if min(of) < 1 or of[0] % 1 or of[1] % 1:
        raise inner.refuse("of", "two whole numbers above 0", "write the size of the calibrated picture")
    inner.done()
    return VideoArea(crop=(crop[0], crop[1], crop[2], crop[3]), of=(int(of[0]), int(of[1])))


SIGMA_KEYS = (
    *(Key(f"{name}_deg", keys.degrees(None, low=0, high=180), f"{name}_rad") for name in ("attitude_bias", "attitude")),
    Key("pixel", keys.number(low=0, above=True), "pixel_px"),
    Key("place", keys.number(low=0), "place_px"),
    *(
        Key(name, keys.number(low=0))
        for name in (
            "position_bias_m",
            "position_m",
            "offset_s",
            "frame_rate",
            "focal",
            "start_s",
            "attitude_tau_s",
            "position_tau_s",
            "readout_s",
        )
    ),
)
"""One standard deviation each. Those given stand in `CameraSettings.sigma` under the setting's name."""

CAMERA_KEYS = (
    Key("calibration", keys.path(needed="make one with `runningfix calibrate`")),
    Key("video", keys.path()),
    Key("video_stream", keys.whole(low=0, high=999)),
    Key("video_area", video_area),
    Key("tracks", keys.path()),
    Key("telemetry", keys.telemetry),
    Key("pose", keys.section(POSE_KEYS, still_pose)),
    Key("tracker", keys.choice(TRACKERS, "kcf")),
    Key("dialect", keys.dialect),
    Key("system", keys.whole(low=1, high=255)),
    Key("gimbal", keys.whole(low=0, high=255)),
    Key("takeoff", keys.section(TAKEOFF_KEYS, TakeoffSettings)),
    Key("start", keys.start),
    Key("frame_rate", keys.number(low=LOWEST_HZ, high=HIGHEST_HZ)),
    Key("offset_s", keys.number_or("search")),
    Key("clock", keys.choice(("auto", "affine", "drift"), "auto")),
    Key("mount", mount),
    Key("mount_correction", keys.section(MOUNT_KEYS, _fixed_mount, MountSettings())),
    Key("lever_arm_m", keys.vector((0.0, 0.0, 0.0))),
    Key("readout_s", keys.number(0.0, low=-LONGEST_READOUT_S, high=LONGEST_READOUT_S)),
    Key("sigma", keys.section(SIGMA_KEYS, lambda **found: keys.given(found), {})),
)


def camera(table: Table, name: str, folder: Path) -> CameraSettings:
    """One `[cameras.NAME]` table."""
    found = keys.read_keys(table, CAMERA_KEYS, folder)
    if found["pose"] is not None and found["telemetry"] is not None:
        raise table.refuse("pose", "either pose or telemetry, not both", "remove one of the two")
    return CameraSettings(name=name, **found)


def box(inner: Table) -> Box:
    """`{ frame = 0, box = [x, y, width, height] }`."""
    frame, sides = inner.whole("frame"), inner.vector("box", 4)
    if sides is None:
        raise inner.refuse("box", "[x, y, width, height] in pixels", "write { frame = 0, box = [612, 340, 24, 18] }")
    if sides[2] < 2 or sides[3] < 2:
        raise inner.refuse("box", "a width and a height of at least 2 px", "boxes are [x, y, width, height]")
    inner.done()
    return Box(frame=frame or 0, x=sides[0], y=sides[1], width=sides[2], height=sides[3])


def boxes(table: Table, key: str, folder: Path) -> dict[str, tuple[Box, ...]]:
    """Boxes by camera, one or a list of them on different frames; in order of the frames."""
    inner = table.table(key)
    return {} if inner is None else {name: _labels(inner, name) for name in inner.content}


def _labels(table: Table, camera: str) -> tuple[Box, ...]:
    written = table.get(camera)
    if not isinstance(written, list):
        return (box(Table(written, table.place(camera))),)
    found = sorted((box(Table(one, f"{table.place(camera)}[{k}]")) for k, one in enumerate(written)), key=_frame)
    if not found or any(one.frame == other.frame for one, other in pairwise(found)):
        raise table.refuse(
            camera, "one box or several on different frames", "write [{ frame = 0, box = [612, 340, 24, 18] }, ...]"
        )
    return tuple(found)


def _frame(one: Box) -> int:
    return one.frame


TARGET_KEYS = (
    Key("boxes", boxes, "labels"),
    Key("motion", keys.choice(("auto", "polynomial", "spline"), "auto")),
    Key("order", keys.choice((*range(6), "auto"), "auto")),
    Key("on_ground", keys.truth()),
    Key("above_ground_m", keys.number(0.0, low=-100, high=1000)),
)


def target(table: Table, name: str, folder: Path) -> TargetSettings:
    """One `[targets.NAME]` table."""
    found = keys.read_keys(table, TARGET_KEYS, folder)
    if found["above_ground_m"] and not found["on_ground"]:
        raise table.refuse("above_ground_m", "on_ground = true beside it", "add on_ground = true, or leave it out")
    return TargetSettings(name=name, **found)


DATUMS = ("ellipsoid", "msl")
GROUND_KEYS = (
    Key("terrain", keys.path()),
    Key("height_m", keys.number(low=-1000, high=10_000)),
    Key("datum", keys.choice(DATUMS, None)),
    Key("sigma_m", keys.number(1.0, low=0, high=1000, above=True)),
    Key("datum_sigma_m", keys.number(low=0)),
)


def ground(table: Table, folder: Path) -> GroundSettings:
    """The `[ground]` table."""
    found = keys.read_keys(table, GROUND_KEYS, folder)
    if (found["terrain"] is None) == (found["height_m"] is None):
        key = "terrain" if found["terrain"] is None else "height_m"
        raise table.refuse(key, "either terrain or height_m", 'write terrain = "dem.tif", or height_m = 61.2')
    if found["datum_sigma_m"] is not None and found["datum_sigma_m"] > found["sigma_m"]:
        raise table.refuse("datum_sigma_m", f"at most sigma_m ({found['sigma_m']:g})", "it is a part of sigma_m")
    return GroundSettings(**found)


POINT = "write points.uav1 = [ { frame = 0, x = 612.4, y = 340.2 } ]"
POINT_KEYS = (
    Key("frame", keys.whole(0)),
    Key("x", keys.needed_number(POINT, expected="pixels", low=-1e5, high=1e5), "x_px"),
    Key("y", keys.needed_number(POINT, expected="pixels", low=-1e5, high=1e5), "y_px"),
    Key("sigma_px", keys.number(1.0, low=0, high=1000, above=True)),
)


def marks(table: Table, key: str, folder: Path) -> tuple[Mark, ...]:
    """`[ { frame = 0, x = 612.4, y = 340.2 }, ... ]`, ordered by frame."""
    value = table.get(key)
    if not isinstance(value, list) or not value:
        raise table.refuse(key, "a list of { frame, x, y }", POINT)
    read = [Table(one, f"{table.place(key)}[{i}]") for i, one in enumerate(value)]
    found = sorted((Mark(**keys.read_keys(one, POINT_KEYS, folder)) for one in read), key=lambda m: m.frame)
    for before, after in pairwise(found):
        if before.frame == after.frame:
            raise table.refuse(key, f"one mark a frame, and frame {after.frame} has two", "keep one of them")
    return tuple(found)


def points(table: Table, key: str, folder: Path) -> dict[str, tuple[Mark, ...]]:
    """Marks by camera."""
    inner = table.table(key)
    return {} if inner is None else {name: marks(inner, name, folder) for name in inner.content}


PLACE_ADVICE = "give lat, lon, height (or east_m, north_m, up_m), or none of them: a still point at an unknown place"
LANDMARK_KEYS = (
    Key("lat", keys.number(low=-90, high=90)),
    Key("lon", keys.number(low=-180, high=180)),
    Key("height", keys.number(low=-1000, high=100_000)),
    Key("datum", keys.choice(DATUMS, "ellipsoid")),
    *(Key(f"{axis}_m", keys.number(low=-1e7, high=1e7)) for axis in ("east", "north", "up")),
    Key("sigma_m", keys.number(0.05, low=0, high=1e6, above=True)),
    Key("sigma_up_m", keys.number(low=0, high=1e6, above=True)),
    Key("check", keys.truth()),
    Key("points", points),
    Key("boxes", boxes),
)


def landmark(table: Table, name: str, folder: Path) -> LandmarkSettings:
    """One `[landmarks.NAME]` table."""
    found = keys.read_keys(table, LANDMARK_KEYS, folder)
    world = [found.pop(key) for key in ("lat", "lon", "height")]
    local = [found.pop(key) for key in ("east_m", "north_m", "up_m")]
    for first, given in (("lat", world), ("east_m", local)):
        if any(v is not None for v in given) and any(v is None for v in given):
            raise table.refuse(first, "all three coordinates", PLACE_ADVICE)
    if None not in (*world, *local):
        raise table.refuse("east_m", "either lat, lon, height or east_m, north_m, up_m", PLACE_ADVICE)
    known = None not in world or None not in local
    if found["check"] and not known:
        raise table.refuse("check", "coordinates beside it, to check against", PLACE_ADVICE)
    if not found["points"] and not found["boxes"]:
        raise table.refuse("points", "where it is seen, in at least one camera", POINT)
    both = set(found["points"]) & set(found["boxes"])
    if both:
        raise table.refuse("boxes", f"points or a box in camera {min(both)}, not both", "keep one of them")
    up = found["sigma_m"] if found["sigma_up_m"] is None else found["sigma_up_m"]
    return LandmarkSettings(
        name=name, place=None if None in world else Geodetic.from_degrees(*world),
        enu_m=None if None in local else (local[0], local[1], local[2]), **{**found, "sigma_up_m": up},
    )  # fmt: skip


SOLVE_KEYS = (
    Key("method", keys.choice(METHODS, "map")),
    Key("frame_rate", keys.choice(("refine", "fixed"), "refine")),
    Key("robust", keys.choice(("huber", "none", "cauchy"), "huber")),
    Key("rate_hz", keys.number(10.0, low=0, high=1000, above=True)),
    Key("search_s", keys.number(120.0, low=0, high=3600, above=True)),
)
