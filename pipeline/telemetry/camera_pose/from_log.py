"""Camera poses at frame times from a flight log.

    position   p_cam(t)  = p_vehicle(t) + R_enu_from_body(t) lever
    fixed      R_enu_from_cam = T  R_enu_from_ned  R_ned_from_body(t)   R_body_from_mount  R_frd_from_cam
    gimbal     R_enu_from_cam = T  R_enu_from_ned  R_ned_from_gimbal(t) R_gimbal_from_mount R_frd_from_cam

T turns the ENU axes where the vehicle is into those of the origin (the vertical turns with the earth's curvature).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_axes_turn_many, enu_from_geodetic, geodetic_from_enu
from pipeline.records import PoseTrack
from pipeline.telemetry.camera_pose.interpolate import interpolate_position, slerp_at, spans, within
from pipeline.telemetry.gimbals.frames import ned_from_mount
from pipeline.telemetry.log.flight_log import EARTH, AttitudeSeries, FlightLog, GimbalSeries, PositionSeries
from pipeline.telemetry.log.missing import missing_attitude, missing_gimbal, missing_position


@dataclass(frozen=True, kw_only=True)
class Mount:
    """How the camera sits: yaw, pitch, roll of the camera (an FRD body along its optical axis) in the vehicle's body,
    or, with `gimbal`, in the gimbal's own axes (zero where the camera looks along them); `correction_rad` (yaw, pitch,
    roll) turns the camera in its mount first."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    gimbal: bool = False
    correction_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def body_from_mount(self) -> Floats:
        """The boresight as a quaternion (4,)."""
        mount = rotation.ned_from_frd(np.array(self.yaw_rad), np.array(self.pitch_rad), np.array(self.roll_rad))
        if not any(self.correction_rad):
            return mount
        return rotation.multiply(mount, rotation.ned_from_frd(*(np.array(angle) for angle in self.correction_rad)))


def camera_poses(
    log: FlightLog,
    *,
    camera: str,
    frame: Ints,
    log_time_s: Floats,
    mount: Mount,
    lever_arm_m: Floats,
    origin: Geodetic,
    where: str,
) -> PoseTrack:
    """Pose of the camera at each frame (n,), whose log times are `log_time_s` (n,).

    `lever_arm_m` (3,) is the camera in body axes (FRD) from the point whose position the log gives; `where` names
    file and key for messages. Raises InputFileError where the log lacks positions, attitudes or (for a gimbal)
    gimbal attitudes, does not reach over a frame, or has a gap longer than MAX_GAP_S there.
    """
    time, lever = np.asarray(log_time_s, float), np.asarray(lever_arm_m, float)
    position = log.position
    if position is None or position.valid.sum() < 2:
        raise missing_position(log, where)
    enu, velocity = _local(position, origin)
    keep = position.valid
    stamp = position.time_s[keep]
    place = interpolate_position(stamp, enu, velocity, time, _spans(log, where, position.source, stamp, time, frame))
    turn = rotation.from_matrix(enu_axes_turn_many(geodetic_from_enu(place, origin), origin))
    body = None if mount.gimbal and not _needs_body(log.gimbal, lever) else body_attitude(log, frame, time, where)
    facing = gimbal_attitude(log, frame, time, body, where) if mount.gimbal else body
    assert facing is not None
    if body is not None and lever.any():
        ned_arm = rotation.rotate(body, lever)
        enu_arm = ned_arm @ rotation.NED_FROM_ENU
        place = place + rotation.rotate(turn, enu_arm)
    attitude = rotation.enu_from_cam(facing, mount.body_from_mount())
    return PoseTrack(
        camera=camera,
        frame=frame,
        time_s=time,
        position_enu_m=place,
        enu_from_cam=rotation.normalised(rotation.multiply(turn, attitude)),
    )


def covered(log: FlightLog, log_time_s: Floats, *, mount: Mount, lever_arm_m: Floats) -> Bools:
    """True (n,) where `camera_poses` can answer: inside the log and in no gap longer than MAX_GAP_S.

    All false where the log lacks positions or attitudes altogether.
    """
    time = np.asarray(log_time_s, float)
    needed: list[PositionSeries | AttitudeSeries | GimbalSeries | None] = [log.position]
    if mount.gimbal:
        needed.append(log.gimbal)
    if not mount.gimbal or _needs_body(log.gimbal, np.asarray(lever_arm_m, float)):
        needed.append(log.attitude)
    inside = np.isfinite(time)
    for series in needed:
        inside = inside & (within(series.time_s[series.valid], time) if series is not None else False)
    return np.asarray(inside)


def body_attitude(log: FlightLog, frame: Ints, time_s: Floats, where: str) -> Floats:
    """ned_from_body (n, 4) of the vehicle at log times (n,); raises as `camera_poses`."""
    series = log.attitude
    if series is None or series.valid.sum() < 2:
        raise missing_attitude(log, where)
    stamp, q = series.time_s[series.valid], series.ned_from_body[series.valid]
    return slerp_at(stamp, q, time_s, _spans(log, where, series.source, stamp, time_s, frame))


def gimbal_attitude(log: FlightLog, frame: Ints, time_s: Floats, body: Floats | None, where: str) -> Floats:
    """ned_from_gimbal (n, 4) at log times (n,); `body` (n, 4) is what its angles may count from."""
    series = log.gimbal
    if series is None or series.valid.sum() < 2:
        raise missing_gimbal(log, where)
    keep = series.valid
    stamp, q, kind = series.time_s[keep], series.attitude[keep], series.frame[keep]
    span = _spans(log, where, series.source, stamp, time_s, frame)
    if np.all(kind == kind[0]):  # in its own frame a stabilised mount moves least
        facing = slerp_at(stamp, q, time_s, span)
        return facing if body is None else ned_from_mount(facing, np.full(len(time_s), kind[0]), body)
    used = np.unique(np.concatenate([span, span + 1]))
    then = body_attitude(log, np.full(len(used), -1), stamp[used], where)
    turned = q.copy()
    turned[used] = ned_from_mount(q[used], kind[used], then)
    return slerp_at(stamp, turned, time_s, span)


def _needs_body(gimbal: GimbalSeries | None, lever: Floats) -> bool:
    return bool(lever.any()) or gimbal is None or not bool((gimbal.frame[gimbal.valid] == EARTH).all())


def _local(position: PositionSeries, origin: Geodetic) -> tuple[Floats, Floats]:
    """ENU metres and ENU velocities (k, 3) of the valid fixes."""
    keep = position.valid
    lat, lon, height = position.lat_rad[keep], position.lon_rad[keep], position.height_m[keep]
    turn = enu_axes_turn_many(np.stack([lat, lon, height], axis=1), origin)
    velocity = (turn @ (position.velocity_ned_mps[keep] @ rotation.NED_FROM_ENU)[:, :, None])[:, :, 0]
    return enu_from_geodetic(lat, lon, height, origin), velocity


def _spans(log: FlightLog, where: str, source: str, stamp_s: Floats, time_s: Floats, frame: Ints) -> Ints:
    """Index (n,) of the sample before each time; raises where a time lies outside or in a gap."""
    part = "" if log.excerpt_s is None else " (read from {:.1f} to {:.1f} s of log time)".format(*log.excerpt_s)
    return spans(stamp_s, time_s, frame, source=f"{log.path.name}, {source}{part}", where=where)
