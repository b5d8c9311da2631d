"""A scene: everything that is true about a flight, in true common time (the reference camera's clock, frame 0 at 0).

    camera position  C(t) = B(t) + R_enu_from_body(t) l          B autopilot, l lever arm in body axes
    camera rotation  enu_from_cam(t) = enu_from_body(t) * body_from_mount, or the gimbal's own attitude
    frame time       t = f / alpha + beta                        (paper eq. 2, true values)
    target           X(t), a spline or polynomial (paper eq. 10)
    pixel            x = K distort(R_cam_from_enu (X - C))       (paper eq. 1)

Attitudes are those of FRD bodies in the NED axes of the scene's origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from calibration.camera import CameraModel, project
from calibration.foundation.arrays import Bools, Floats, Ints, frozen, settle
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Motion


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """A smooth function of common time: a cubic spline through samples, constant where there is only one.

    time_s  (n,) increasing
    value   (n, k)
    """

    time_s: Floats
    value: Floats

    def __post_init__(self) -> None:
        n = len(self.time_s)
        settle(self, time_s=frozen(self.time_s, (n,), "time_s"), value=frozen(self.value, (n, None), "value"))

    def __call__(self, time_s: Floats) -> Floats:
        """Values (m, k) at common times (m,)."""
        at = np.asarray(time_s, float)
        if len(self.time_s) == 1:
            return np.repeat(self.value, len(at), axis=0)
        return np.asarray(CubicSpline(self.time_s, self.value)(at))

    def rate(self, time_s: Floats) -> Floats:
        """First derivative (m, k) at common times (m,)."""
        at = np.asarray(time_s, float)
        if len(self.time_s) == 1:
            return np.zeros((len(at), self.value.shape[1]))
        return np.asarray(CubicSpline(self.time_s, self.value)(at, 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Platform:
    """The UAV that carries a camera.

    position_enu_m      path (3) of the autopilot
    yaw_pitch_roll_rad  path (3) of the body
    gimbal_rad          path (3): yaw, pitch, roll of the camera itself, where a gimbal turns it; None: fixed mount
    mount_rad           yaw, pitch, roll of the camera in the body, where it is fixed
    lever_arm_m         camera in body axes
    """

    position_enu_m: Path
    yaw_pitch_roll_rad: Path
    gimbal_rad: Path | None = None
    mount_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneCamera:
    """One camera with its true clock, and what a user would be told of that clock.

    frame_rate      true alpha, frames per second of common time
    nominal_rate    what the container and the flight file say
    offset_s        true beta
    given_offset_s  what the user says of beta; None: nothing is known
    frames          number of frames
    """

    name: str
    lens: CameraModel
    platform: Platform
    frame_rate: float
    nominal_rate: float
    offset_s: float
    frames: int
    given_offset_s: float | None = None

    def frame_time_s(self, frame: Ints) -> Floats:
        """True common time (n,) of frames (n,)."""
        return np.asarray(np.asarray(frame, float) / self.frame_rate + self.offset_s)


@dataclass(frozen=True, kw_only=True)
class VehicleShape:
    """A box on wheels: what is drawn of a target. Its reference point is the centre of the roof.

    length_m, width_m   of the roof
    roof_m              height of the roof above the ground
    skirt_m             height of the walls
    colour              blue, green, red (0 to 255) of the roof
    seed                of the pattern painted on the roof
    """

    length_m: float
    width_m: float
    roof_m: float
    skirt_m: float
    colour: tuple[int, int, int]
    seed: int


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneTarget:
    """One target. `motion` is the true path of the reference point: the roof's centre where there is a shape."""

    name: str
    motion: Motion
    shape: VehicleShape | None = None


@dataclass(frozen=True, kw_only=True)
class Bridge:
    """A level deck above the ground that hides what passes under it.

    centre_enu_m  (east, north, up) of the deck's middle
    heading_rad   of its long axis, from north clockwise
    """

    centre_enu_m: tuple[float, float, float]
    heading_rad: float
    length_m: float
    width_m: float

    def hides(self, camera_enu_m: Floats, point_enu_m: Floats) -> Bools:
        """(n,) true where the line from the camera (n, 3) to the point (n, 3) passes through the deck."""
        east, north, up = self.centre_enu_m
        share = (up - point_enu_m[:, 2]) / (camera_enu_m[:, 2] - point_enu_m[:, 2])
        cross = point_enu_m + share[:, None] * (camera_enu_m - point_enu_m) - np.array([east, north, up])
        sine, cosine = np.sin(self.heading_rad), np.cos(self.heading_rad)
        along = cross[:, 0] * sine + cross[:, 1] * cosine
        across = cross[:, 0] * cosine - cross[:, 1] * sine
        inside = (abs(along) <= self.length_m / 2) & (abs(across) <= self.width_m / 2)
        return np.asarray(inside & (share > 0) & (share < 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Road:
    """A road on the ground: its centre line (n, 2) in east and north metres, and its width."""

    line_m: Floats
    width_m: float

    def __post_init__(self) -> None:
        settle(self, line_m=frozen(self.line_m, (None, 2), "line_m"))


@dataclass(frozen=True, kw_only=True, eq=False)
class Landscape:
    """What is drawn around the targets, in ENU metres; the ground is the plane up = 0.

    half_size_m  of the textured square around (0, 0)
    texel_m      size of one pixel of that texture
    seed         of fields, trees and wear
    roads        all of them, those under the targets too
    bridge       over a road, or None
    """

    half_size_m: float
    texel_m: float
    seed: int
    roads: tuple[Road, ...] = ()
    bridge: Bridge | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A whole flight. The first camera is the reference: its offset is 0 and its nominal rate is true."""

    name: str
    cameras: tuple[SceneCamera, ...]
    targets: tuple[SceneTarget, ...]
    origin: Geodetic
    landscape: Landscape | None = None

    def __post_init__(self) -> None:
        first = self.cameras[0]
        if first.offset_s != 0.0 or first.frame_rate != first.nominal_rate:
            raise ValueError(f"{first.name}: the first camera's clock is common time")

    def camera(self, name: str) -> SceneCamera:
        """The camera of that name."""
        return next(c for c in self.cameras if c.name == name)

    @property
    def span_s(self) -> tuple[float, float]:
        """Common time from the first frame of any camera to the last."""
        first = min(c.offset_s for c in self.cameras)
        return first, max(float(c.frame_time_s(np.array([c.frames - 1]))[0]) for c in self.cameras)


def body_pose(platform: Platform, time_s: Floats) -> tuple[Floats, Floats]:
    """Autopilot position (n, 3) ENU and attitude ned_from_body (n, 4) at common times (n,)."""
    yaw, pitch, roll = platform.yaw_pitch_roll_rad(time_s).T
    return platform.position_enu_m(time_s), rotation.ned_from_frd(yaw, pitch, roll)


def camera_pose(platform: Platform, time_s: Floats) -> tuple[Floats, Floats]:
    """Optical centre (n, 3) ENU and enu_from_cam (n, 4) at common times (n,)."""
    position, ned_from_body = body_pose(platform, time_s)
    if platform.gimbal_rad is None:
        body_from_mount = rotation.ned_from_frd(*(np.array(angle) for angle in platform.mount_rad))
        enu_from_cam = rotation.enu_from_cam(ned_from_body, body_from_mount)
    else:
        enu_from_cam = rotation.enu_from_cam(rotation.ned_from_frd(*platform.gimbal_rad(time_s).T))
    lever_ned = rotation.rotate(ned_from_body, np.array(platform.lever_arm_m))
    return position + lever_ned @ rotation.NED_FROM_ENU, enu_from_cam


def pixels_of(camera: SceneCamera, frame: Ints, points_enu_m: Floats) -> tuple[Floats, Floats]:
    """True pixels (n, 2) of one point (n, 3) per frame (n,), NaN behind the camera; and the optical centres (n, 3)."""
    centre, enu_from_cam = camera_pose(camera.platform, camera.frame_time_s(frame))
    in_cam = rotation.rotate(rotation.conjugate(enu_from_cam), points_enu_m - centre)
    return project(camera.lens, in_cam), centre


def visible(scene: Scene, camera: SceneCamera, pixels: Floats, centre: Floats, points: Floats) -> Bools:
    """(n,) true where a point is inside the image and no bridge hides it."""
    width, height = camera.lens.image_size
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels <= np.array([width - 1, height - 1]))).all(axis=1)
    if scene.landscape is None or scene.landscape.bridge is None:
        return np.asarray(inside)
    return np.asarray(inside & ~scene.landscape.bridge.hides(centre, points))


def polynomial_motion(target: str, coefficients: Floats, span_s: tuple[float, float]) -> Motion:
    """A polynomial path (paper eq. 10): position = sum of row k of `coefficients` (K + 1, 3) times t^k."""
    powers = np.asarray(coefficients, float)
    order = len(powers) - 1
    start, end = span_s
    at = np.linspace(start, end, max(order + 1, 2))
    value = (at[:, None] ** np.arange(order + 1)) @ powers
    spline = make_interp_spline(at, value, k=order) if order else None
    kind: Literal["polynomial"] = "polynomial"
    return Motion(
        target=target,
        kind=kind,
        degree=order,
        knots_s=np.array([start, end]) if spline is None else spline.t,
        coefficients=powers if spline is None else spline.c,
        start_s=start,
        end_s=end,
    )


def look_at(position_enu_m: Floats, point_enu_m: Floats) -> tuple[Floats, Floats]:
    """Yaw and pitch (n,) of a camera at `position` (n, 3) whose optical axis meets `point` (n, 3) or (3,)."""
    east, north, up = np.moveaxis(np.asarray(point_enu_m) - np.asarray(position_enu_m), -1, 0)
    return np.unwrap(np.arctan2(east, north)), np.arctan2(up, np.hypot(east, north))
