"""Camera poses of a flight, as measured: from logs, from tables, or still.

Log time of frame f is `start` + its video time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime

import numpy as np

from calibration.arrays import Floats, Ints
from pipeline.errors import UsageError
from pipeline.flight import CameraSettings, Flight, MountSettings
from pipeline.geometry import rotation
from pipeline.records import ImageTrack, InstrumentSigma, PoseTrack
from pipeline.records.problem import PoseAt
from pipeline.stages.frames import VideoClock, frame_rate, video_clock, video_time_s
from pipeline.stages.sources import Sources
from pipeline.telemetry import (
    FlightLog,
    Mount,
    PoseTable,
    camera_poses,
    log_sigma,
    log_span,
    resolve_start,
    table_poses,
    utc_at,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPoses:
    """One camera's measured poses and what the instruments say of them.

    frame_rate  nominal, Hz
    utc_s       UTC of frame 0 where it is known
    poses_at    poses at frames' log times moved by (n,) seconds, where they came from a log
    notes       what a reader should know
    """

    camera: str
    poses: PoseTrack
    frame_rate: float
    sigma: InstrumentSigma
    still: bool
    utc_s: float | None = None
    poses_at: Callable[[PoseTrack], PoseAt] | None = None
    notes: tuple[str, ...] = ()


def measure_poses(flight: Flight, sources: Sources, tracks: tuple[ImageTrack, ...] = ()) -> tuple[MeasuredPoses, ...]:
    """The measured poses of every camera, at every frame of its video, else of its detections, else of its log."""
    return tuple(_measure(flight, camera, sources, tracks) for camera in flight.cameras)


def _measure(flight: Flight, camera: CameraSettings, sources: Sources, tracks: tuple[ImageTrack, ...]) -> MeasuredPoses:
    clock = video_clock(camera)
    rate = frame_rate(flight, camera, clock)
    if camera.pose is not None:
        frame, time = _frames(camera, clock, rate, tracks)
        return _still(flight, camera, frame, time, rate)
    if camera.name in sources.logs:
        return _from_log(flight, camera, sources, clock, rate, tracks)
    if camera.name in sources.tables:
        return _from_table(flight, camera, sources.tables[camera.name], clock, rate, tracks)
    raise UsageError(
        where=flight.key(camera.name, "telemetry"),
        seen="neither telemetry nor pose",
        expected="where the camera was",
        advice='write telemetry = "flight.tlog", or pose = { east_m = ..., ... } for a camera that stands still',
    )


def _frames(
    camera: CameraSettings, clock: VideoClock | None, rate: float, tracks: tuple[ImageTrack, ...]
) -> tuple[Ints, Floats]:
    """Frames and video times: of the video, else of the detections."""
    if clock is not None:
        frame = np.arange(len(clock.time_s))
        return frame, video_time_s(frame, rate, clock)
    own = [t for t in tracks if t.camera == camera.name]
    if not own:
        return np.zeros(0, np.int64), np.zeros(0)
    frame, first = np.unique(np.concatenate([t.frame for t in own]), return_index=True)
    return frame, np.concatenate([t.time_s for t in own])[first]


def _still(flight: Flight, camera: CameraSettings, frame: Ints, time: Floats, rate: float) -> MeasuredPoses:
    assert camera.pose is not None
    pose = camera.pose
    attitude = rotation.ned_from_frd(np.array(pose.yaw_rad), np.array(pose.pitch_rad), np.array(pose.roll_rad))
    if not len(frame):
        frame, time = np.zeros(1, np.int64), np.zeros(1)
    poses = PoseTrack(
        camera=camera.name,
        frame=frame,
        time_s=time,
        position_enu_m=np.tile(pose.position_enu_m, (len(frame), 1)),
        enu_from_cam=np.tile(rotation.enu_from_cam(attitude), (len(frame), 1)),
    )
    utc = _utc_of_text(flight, camera)
    sigma = _sigma(camera, InstrumentSigma(attitude_rad=0.0, position_m=0.0), knows_utc=utc is not None)
    return MeasuredPoses(camera=camera.name, poses=poses, frame_rate=rate, sigma=sigma, still=True, utc_s=utc)


def _utc_of_text(flight: Flight, camera: CameraSettings) -> float | None:
    if not isinstance(camera.start, str):
        return None
    if camera.start == "camera-event":
        raise UsageError(
            where=flight.key(camera.name, "start"),
            seen='"camera-event" without a log',
            expected="a UTC time for a camera that has no log",
            advice='write start = "2025-06-01T09:30:00Z", or leave it out',
        )
    when = datetime.fromisoformat(camera.start)
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _from_log(
    flight: Flight,
    camera: CameraSettings,
    sources: Sources,
    clock: VideoClock | None,
    rate: float,
    tracks: tuple[ImageTrack, ...],
) -> MeasuredPoses:
    log, where = sources.logs[camera.name], flight.key(camera.name, "telemetry")
    frame, time = _frames(camera, clock, rate, tracks)
    if not len(frame) and camera.tracks is None and camera.video is None:
        begin, end = log_span(log)
        start = (
            begin if camera.start is None else resolve_start(log, camera.start, where=flight.key(camera.name, "start"))
        )
        frame = np.arange(int((end - start) * rate) + 1)
        time = frame / rate
    else:
        start = _start(flight, camera, log)
    assert sources.origin is not None
    origin, mount, lever = sources.origin, _mount(camera.mount), np.array(camera.lever_arm_m)

    def at(frames: Ints, log_time_s: Floats) -> PoseTrack:
        return camera_poses(
            log, camera=camera.name, frame=frames, log_time_s=log_time_s, mount=mount, lever_arm_m=lever,
            origin=origin, where=where,
        )  # fmt: skip

    utc = utc_at(log, start)
    return MeasuredPoses(
        camera=camera.name,
        poses=at(frame, start + time),
        frame_rate=rate,
        sigma=_sigma(camera, log_sigma(log), knows_utc=utc is not None),
        still=False,
        utc_s=utc,
        poses_at=lambda base: lambda shift_s: at(base.frame, base.time_s + shift_s),
        notes=log.notes,
    )


def _start(flight: Flight, camera: CameraSettings, log: FlightLog) -> float:
    where = flight.key(camera.name, "start")
    if camera.start is None:
        raise UsageError(
            where=where,
            seen="missing",
            expected="the log time of the video's frame 0",
            advice='write start = "camera-event" where the log has camera events, seconds on the log\'s clock, or an '
            "ISO-8601 UTC time",
        )
    return resolve_start(log, camera.start, where=where)


def _from_table(
    flight: Flight,
    camera: CameraSettings,
    table: PoseTable,
    clock: VideoClock | None,
    rate: float,
    tracks: tuple[ImageTrack, ...],
) -> MeasuredPoses:
    frame, time = _frames(camera, clock, rate, tracks)
    if not len(frame) and table.frame is not None:
        frame, time = table.frame, table.frame / rate
    where = flight.key(camera.name, "telemetry")
    if table.frame is None and isinstance(camera.start, str):
        raise UsageError(
            where=flight.key(camera.name, "start"),
            seen=f'"{camera.start}" beside a table of poses by time_s',
            expected="seconds on the table's own clock",
            advice="write start = 12.34, the time_s of the video's frame 0",
        )
    start = camera.start if isinstance(camera.start, float) else 0.0

    def at(frames: Ints, log_time_s: Floats) -> PoseTrack:
        return table_poses(table, camera=camera.name, frame=frames, log_time_s=log_time_s, where=where)

    poses_at = None if table.frame is not None else (lambda base: lambda shift: at(base.frame, base.time_s + shift))
    utc = _utc_of_text(flight, camera)
    return MeasuredPoses(
        camera=camera.name,
        poses=at(frame, start + time),
        frame_rate=rate,
        sigma=_sigma(camera, InstrumentSigma(), knows_utc=utc is not None),
        still=False,
        utc_s=utc,
        poses_at=poses_at,
    )


def _mount(mount: MountSettings) -> Mount:
    return Mount(yaw_rad=mount.yaw_rad, pitch_rad=mount.pitch_rad, roll_rad=mount.roll_rad, gimbal=mount.gimbal)


def _sigma(camera: CameraSettings, default: InstrumentSigma, *, knows_utc: bool) -> InstrumentSigma:
    """What the flight file gives, else the instruments' own words; an offset has a prior only where it is known."""
    given = {f.name: camera.sigma[f.name] for f in fields(InstrumentSigma) if f.name in camera.sigma}
    if camera.offset_s is None and not knows_utc:
        given.pop("offset_s", None)
    elif camera.offset_s is None and "offset_s" not in given:
        given["offset_s"] = 1.0
    return replace(default, **given)
