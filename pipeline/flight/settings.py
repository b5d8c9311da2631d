"""What a flight file says, in SI units and radians; `None` where it says nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Box, TrackerName
from pipeline.records.motion import MotionAsked
from pipeline.records.problem import ClockKind, Method, Robust

Vector = tuple[float, float, float]
CAMERA_EVENT, AUTO = "camera-event", "auto"
IN_THE_VIDEO = "video"
"""`telemetry` where the video itself carries it."""
"""`start` in words: the first exposure that the log knows of; found by the camera's turning."""


@dataclass(frozen=True, kw_only=True)
class StillPose:
    """A camera that stands still: ENU metres, and yaw, pitch, roll of the FRD body that looks along its axis."""

    position_enu_m: Vector
    yaw_rad: float
    pitch_rad: float
    roll_rad: float


@dataclass(frozen=True, kw_only=True)
class MountSettings:
    """Camera to body: fixed FRD angles, or `gimbal`: read from the log. `given`: the flight file says so."""

    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    gimbal: bool = False
    given: bool = False


@dataclass(frozen=True, kw_only=True)
class TakeoffSettings:
    """How high the take-off place is, for logs that give heights above it: above the ellipsoid, or mean sea level."""

    height_m: float
    datum: Literal["ellipsoid", "msl"] = "ellipsoid"


@dataclass(frozen=True, kw_only=True)
class VideoArea:
    """What a video shows of the calibrated picture: crop (x, y, width, height) of a picture of size `of`, pixels."""

    crop: tuple[float, float, float, float]
    of: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """One `[cameras.NAME]` table.

    Paths are absolute; `dialect` is a name or a path. `tracker` is the coarse tracker in `video`, where there are no
    `tracks`; `video_stream` picks one of several pictures in the video. `system` and `gimbal` pick one of several in a
    log. `mount_correction` turns the camera in its mount or gimbal. `sigma` holds only the keys that were given, in SI
    units.
    """

    name: str
    calibration: Path
    video: Path | None = None
    video_stream: int | None = None
    video_area: VideoArea | None = None
    tracks: Path | None = None
    tracker: TrackerName = "kcf"
    telemetry: Path | None = None
    dialect: str = ""
    system: int | None = None
    gimbal: int | None = None
    takeoff: TakeoffSettings | None = None
    pose: StillPose | None = None
    start: float | str | None = None
    frame_rate: float | None = None
    offset_s: float | None = None
    clock: ClockKind = "auto"
    mount: MountSettings = MountSettings()
    mount_correction: MountSettings = MountSettings()
    lever_arm_m: Vector = (0.0, 0.0, 0.0)
    readout_s: float = 0.0
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class GroundSettings:
    """The `[ground]` table: a terrain model or one height.

    datum     what heights count from; None: the terrain model's own word (one height: the ellipsoid)
    sigma_m   of the ground's height along a target's stretch; datum_sigma_m  the part of it that all targets share
    """

    terrain: Path | None = None
    height_m: float | None = None
    datum: Literal["ellipsoid", "msl"] | None = None
    sigma_m: float = 1.0
    datum_sigma_m: float | None = None

    @property
    def common_m(self) -> float:
        """The part that all targets share: as said, else half of the variance."""
        return self.sigma_m * math.sqrt(0.5) if self.datum_sigma_m is None else self.datum_sigma_m


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A still point marked in one frame: pixel (0, 0) is the middle of the top-left pixel. `sigma_px` per axis."""

    frame: int
    x_px: float
    y_px: float
    sigma_px: float = 1.0


@dataclass(frozen=True, kw_only=True)
class LandmarkSettings:
    """One `[landmarks.NAME]` table: a still point; without a place it is unknown.

    place      latitude and longitude in radians, height above `datum`; enu_m  the same in local ENU
    sigma_m, sigma_up_m  horizontal per axis, and vertical
    check      its coordinates are only held against the answer
    points, boxes  where it is seen, by camera
    """

    name: str
    place: Geodetic | None = None
    datum: Literal["ellipsoid", "msl"] = "ellipsoid"
    enu_m: Vector | None = None
    sigma_m: float = 0.05
    sigma_up_m: float = 0.05
    check: bool = False
    points: Mapping[str, tuple[Mark, ...]] = field(default_factory=dict)
    boxes: Mapping[str, Box] = field(default_factory=dict)

    @property
    def surveyed(self) -> bool:
        """Whether its place is given."""
        return self.place is not None or self.enu_m is not None


@dataclass(frozen=True, kw_only=True)
class TargetSettings:
    """One `[targets.NAME]` table; `labels` are its boxes by camera, in order of their frames.

    An `order` that is given means a polynomial. on_ground, above_ground_m: it stays so high above the ground.
    """

    name: str
    motion: MotionAsked = "auto"
    order: int | Literal["auto"] = "auto"
    on_ground: bool = False
    above_ground_m: float = 0.0
    labels: Mapping[str, tuple[Box, ...]] = field(default_factory=dict)

    @property
    def boxes(self) -> Mapping[str, Box]:
        """The first box by camera."""
        return {camera: boxes[0] for camera, boxes in self.labels.items()}


@dataclass(frozen=True, kw_only=True)
class SolveSettings:
    """The `[solve]` table."""

    method: Method = "map"
    frame_rate: Literal["refine", "fixed"] = "refine"
    robust: Robust = "huber"
    rate_hz: float = 10.0
    search_s: float = 120.0


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A whole flight file.

    path              of the file; errors name it
    origin            of the ENU frame, or None: the first position of the first log
    reference_camera  whose clock is common time
    """

    path: Path
    title: str
    origin: Geodetic | None
    reference_camera: str
    cameras: tuple[CameraSettings, ...]
    targets: tuple[TargetSettings, ...]
    solve: SolveSettings = SolveSettings()
    ground: GroundSettings | None = None
    landmarks: tuple[LandmarkSettings, ...] = ()

    def boxes(self, camera: str) -> dict[str, Box]:
        """First boxes in one camera, of targets and of landmarks that are tracked like them."""
        of_targets = {t.name: t.boxes[camera] for t in self.targets if camera in t.boxes}
        return of_targets | {m.name: m.boxes[camera] for m in self.landmarks if camera in m.boxes}

    def camera(self, name: str) -> CameraSettings:
        """The settings of one camera."""
        return next(c for c in self.cameras if c.name == name)

    def key(self, camera: str, key: str) -> str:
        """Where a camera's key stands, for messages."""
        return f"{self.path}: cameras.{camera}.{key}"
