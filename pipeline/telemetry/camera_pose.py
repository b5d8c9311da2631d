"""Camera poses at frame times from a flight log.

    position   p_cam(t)  = p_vehicle(t) + R_enu_from_body(t) lever
    fixed      R_enu_from_cam = T  R_enu_from_ned  R_ned_from_body(t)   R_body_from_mount  R_frd_from_cam
    gimbal     R_enu_from_cam = T  R_enu_from_ned  R_ned_from_gimbal(t) R_gimbal_from_mount R_frd_from_cam

T turns the ENU axes where the vehicle is into those of the origin (the vertical turns with the earth's curvature).
Attitudes go by slerp between the two samples around t; positions by the cubic that keeps the log's velocities, or
straight where the log has none that fit. Nothing is extrapolated, and no gap longer than MAX_GAP_S is bridged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic, enu_axes_turn_many, enu_from_geodetic, geodetic_from_enu
from pipeline.records import PoseTrack
from pipeline.telemetry.flight_log import EARTH, AttitudeSeries, FlightLog, GimbalSeries, PositionSeries
from pipeline.telemetry.gimbal_frames import ned_from_mount
from pipeline.telemetry.missing import missing_attitude, missing_gimbal, missing_position

MAX_GAP_S = 3.0
"""Between samples further apart than this nothing is interpolated: a UAV turns and climbs meanwhile."""
VELOCITY_WINDOW_S = 2.0
VELOCITY_TOLERANCE_MPS = 1.0


@dataclass(frozen=True, kw_only=True)
class Mount:
    """How the camera sits: yaw, pitch, roll of the camera (an FRD body along its optical axis) in the vehicle's body,
    or, with `gimbal`, in the gimbal's own axes (zero where the camera looks along them)."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    gimbal: bool = False

    def body_from_mount(self) -> Floats:
        """The boresight as a quaternion (4,)."""
        return rotation.ned_from_frd(np.array(self.yaw_rad), np.array(self.pitch_rad), np.array(self.roll_rad))


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


def within(stamp_s: Floats, time_s: Floats, *, max_gap_s: float = MAX_GAP_S) -> Bools:
    """True (n,) where a time has samples on both sides of it, at most `max_gap_s` apart."""
    if len(stamp_s) < 2:
        return np.zeros(len(time_s), dtype=bool)
    right = np.clip(np.searchsorted(stamp_s, time_s, side="right"), 1, len(stamp_s) - 1)
    bridged = stamp_s[right] - stamp_s[right - 1] <= max_gap_s
    return np.asarray((time_s >= stamp_s[0]) & (time_s <= stamp_s[-1]) & bridged)


def body_attitude(log: FlightLog, frame: Ints, time_s: Floats, where: str) -> Floats:
    """ned_from_body (n, 4) of the vehicle at log times (n,); raises as `camera_poses`."""
    series = log.attitude
    if series is None or series.valid.sum() < 2:
        raise missing_attitude(log, where)
    stamp, q = series.time_s[series.valid], series.ned_from_body[series.valid]
    return _slerp_at(stamp, q, time_s, _spans(log, where, series.source, stamp, time_s, frame))


def gimbal_attitude(log: FlightLog, frame: Ints, time_s: Floats, body: Floats | None, where: str) -> Floats:
    """ned_from_gimbal (n, 4) at log times (n,); `body` (n, 4) is what its angles may count from."""
    series = log.gimbal
    if series is None or series.valid.sum() < 2:
        raise missing_gimbal(log, where)
    keep = series.valid
    stamp, q, kind = series.time_s[keep], series.attitude[keep], series.frame[keep]
    span = _spans(log, where, series.source, stamp, time_s, frame)
    if np.all(kind == kind[0]):  # in its own frame a stabilised mount moves least
        facing = _slerp_at(stamp, q, time_s, span)
        return facing if body is None else ned_from_mount(facing, np.full(len(time_s), kind[0]), body)
    used = np.unique(np.concatenate([span, span + 1]))
    then = body_attitude(log, np.full(len(used), -1), stamp[used], where)
    turned = q.copy()
    turned[used] = ned_from_mount(q[used], kind[used], then)
    return _slerp_at(stamp, turned, time_s, span)


def interpolate_position(stamp_s: Floats, enu_m: Floats, velocity_mps: Floats, time_s: Floats, span: Ints) -> Floats:
    """Positions (n, 3) at times (n,) inside spans (n,): the cubic through places and velocities, else the chord."""
    left, right = span, span + 1
    step = stamp_s[right] - stamp_s[left]
    s = (time_s - stamp_s[left]) / step
    chord = enu_m[left] + s[:, None] * (enu_m[right] - enu_m[left])
    if not velocities_fit(stamp_s, enu_m, velocity_mps):
        return np.asarray(chord)
    mean = (enu_m[right] - enu_m[left]) / step[:, None]
    bend = (s * (1 - s) * step)[:, None] * (
        (1 - s)[:, None] * (velocity_mps[left] - mean) - s[:, None] * (velocity_mps[right] - mean)
    )
    return np.where(np.isfinite(bend), chord + bend, chord)


def velocities_fit(stamp_s: Floats, enu_m: Floats, velocity_mps: Floats) -> bool:
    """Whether the velocities are those of the positions: they agree over windows of VELOCITY_WINDOW_S."""
    ahead = np.searchsorted(stamp_s, stamp_s + VELOCITY_WINDOW_S)
    first = np.flatnonzero(ahead < len(stamp_s))
    first = first[:: max(1, len(first) // 1000)]
    if len(first) == 0:
        return False
    last = ahead[first]
    step = np.diff(stamp_s)[:, None]
    travelled = np.concatenate([np.zeros((1, 3)), np.cumsum((velocity_mps[1:] + velocity_mps[:-1]) / 2 * step, axis=0)])
    window = (stamp_s[last] - stamp_s[first])[:, None]
    miss = np.linalg.norm((enu_m[last] - enu_m[first] - (travelled[last] - travelled[first])) / window, axis=1)
    return bool(np.median(miss) < VELOCITY_TOLERANCE_MPS)


def _needs_body(gimbal: GimbalSeries | None, lever: Floats) -> bool:
    return bool(lever.any()) or gimbal is None or not bool((gimbal.frame[gimbal.valid] == EARTH).all())


def _local(position: PositionSeries, origin: Geodetic) -> tuple[Floats, Floats]:
    """ENU metres and ENU velocities (k, 3) of the valid fixes."""
    keep = position.valid
    lat, lon, height = position.lat_rad[keep], position.lon_rad[keep], position.height_m[keep]
    turn = enu_axes_turn_many(np.stack([lat, lon, height], axis=1), origin)
    velocity = (turn @ (position.velocity_ned_mps[keep] @ rotation.NED_FROM_ENU)[:, :, None])[:, :, 0]
    return enu_from_geodetic(lat, lon, height, origin), velocity


def _slerp_at(stamp_s: Floats, q: Floats, time_s: Floats, span: Ints) -> Floats:
    share = (time_s - stamp_s[span]) / (stamp_s[span + 1] - stamp_s[span])
    return rotation.slerp(q[span], q[span + 1], share)


def _spans(log: FlightLog, where: str, source: str, stamp_s: Floats, time_s: Floats, frame: Ints) -> Ints:
    """Index (n,) of the sample before each time; raises where a time lies outside or in a gap."""
    part = "" if log.excerpt_s is None else " (read from {:.1f} to {:.1f} s of log time)".format(*log.excerpt_s)
    return spans(stamp_s, time_s, frame, source=f"{log.path.name}, {source}{part}", where=where)


def spans(
    stamp_s: Floats, time_s: Floats, frame: Ints, *, source: str, where: str, max_gap_s: float = MAX_GAP_S
) -> Ints:
    """Index (n,) of the sample before each time in non-decreasing `stamp_s`; samples with equal stamps are skipped.

    Raises InputFileError where a time lies outside of the samples or between two further apart than `max_gap_s`.
    """
    outside = ~((time_s >= stamp_s[0]) & (time_s <= stamp_s[-1]))
    if outside.any():
        raise _outside(stamp_s, time_s, frame, outside, source, where)
    span = np.clip(np.searchsorted(stamp_s, time_s, side="right") - 1, 0, len(stamp_s) - 2)
    final = int(np.searchsorted(stamp_s, stamp_s[-1], side="left")) - 1
    span = np.where(stamp_s[span + 1] > stamp_s[span], span, final)
    gap = stamp_s[span + 1] - stamp_s[span]
    if np.any(gap > max_gap_s):
        worst, bad = int(gap.argmax()), gap > max_gap_s
        raise InputFileError(
            where=where,
            seen=f"{source} has no sample between {stamp_s[span[worst]]:.3f} and {stamp_s[span[worst] + 1]:.3f} s"
            f" of log time, where {int(bad.sum())} frames lie (first: {_name(frame, time_s, bad)})",
            expected=f"samples at most {max_gap_s:g} s apart around every frame",
            advice="use the video before or after the gap, or the log stored on board, which has no radio gaps",
        )
    return np.asarray(span, dtype=np.int64)


def _outside(stamp_s: Floats, time_s: Floats, frame: Ints, outside: Bools, source: str, where: str) -> InputFileError:
    away = max(float(stamp_s[0] - np.nanmin(time_s)), float(np.nanmax(time_s) - stamp_s[-1]))
    advice = "check `start` (log time of frame 0)"
    if bool(outside.all()) and away > 3600:
        advice += "; the times are hours apart, so this may be the log of another day or another flight"
    elif not outside.all():
        advice += ", or use only the frames that the log covers"
    return InputFileError(
        where=where,
        seen=f"{int(outside.sum())} of {len(time_s)} frames lie outside of {source}"
        f" (first: {_name(frame, time_s, outside)}; the log covers {stamp_s[0]:.3f} to {stamp_s[-1]:.3f} s)",
        expected="every frame inside the log: poses are interpolated, never extrapolated",
        advice=advice,
    )


def _name(frame: Ints, time_s: Floats, which: Bools) -> str:
    first = int(np.flatnonzero(which)[0])
    return f"frame {int(frame[first])} at {time_s[first]:.3f} s of log time"
