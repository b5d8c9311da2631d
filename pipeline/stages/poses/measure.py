"""Camera poses of a flight, as measured: from logs, from tables, or still.

Log time of frame f is `start` + its video time, or that of its own camera event where the log has one for each.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import UsageError
from calibration.foundation.progress import Progress, silent
from pipeline.flight import AUTO, CAMERA_EVENT, CameraSettings, Flight
from pipeline.geometry import rotation
from pipeline.records import ImageTrack, InstrumentSigma, PoseTrack
from pipeline.stages.inputs.frames import VideoClock, frame_rate, video_clock
from pipeline.stages.inputs.sources import Sources
from pipeline.stages.inputs.whose import gimbal_left_out
from pipeline.stages.poses.measured import MeasuredPoses, sigma_in_force, utc_of_start, wanted_frames
from pipeline.stages.poses.start_by_turning import FoundStart, auto_start
from pipeline.telemetry import (
    FlightLog,
    Mount,
    PoseTable,
    camera_poses,
    covered,
    event_times,
    log_seconds,
    log_sigma,
    log_span,
    position_worth,
    resolve_start,
    table_poses,
    utc_at,
)

TYPED_START_S = float(np.sqrt(0.5))
"""Two starts that people gave differ from their true difference by a second, one sigma."""


def measure_poses(
    flight: Flight, sources: Sources, tracks: tuple[ImageTrack, ...] = (), progress: Progress = silent
) -> tuple[MeasuredPoses, ...]:
    """The measured poses of every camera, at every frame of its video, else of its detections, else of its log."""
    return tuple(_measure(flight, camera, sources, tracks, progress) for camera in flight.cameras)


def _measure(
    flight: Flight, camera: CameraSettings, sources: Sources, tracks: tuple[ImageTrack, ...], progress: Progress
) -> MeasuredPoses:
    clock = video_clock(camera)
    rate = frame_rate(flight, camera, clock)
    if camera.pose is not None:
        frame, time = wanted_frames(camera, clock, rate, tracks)
        return _still(flight, camera, frame, time, rate)
    if camera.name in sources.logs:
        return _from_log(flight, camera, sources, clock, rate, tracks, progress)
    if camera.name in sources.tables:
        return _from_table(flight, camera, sources.tables[camera.name], clock, rate, tracks)
    raise UsageError(
        where=flight.key(camera.name, "telemetry"),
        seen="neither telemetry nor pose",
        expected="where the camera was",
        advice='write telemetry = "flight.tlog", or pose = { east_m = ..., ... } for a camera that stands still',
    )


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
    utc = utc_of_start(flight, camera)
    sigma = sigma_in_force(camera, InstrumentSigma(attitude_rad=0.0, position_m=0.0), knows_utc=utc is not None)
    return MeasuredPoses(camera=camera.name, poses=poses, frame_rate=rate, sigma=sigma, still=True, utc_s=utc)


def _from_log(
    flight: Flight,
    camera: CameraSettings,
    sources: Sources,
    clock: VideoClock | None,
    rate: float,
    tracks: tuple[ImageTrack, ...],
    progress: Progress,
) -> MeasuredPoses:
    log, where = sources.logs[camera.name], flight.key(camera.name, "telemetry")
    mount, lever, origin = _mount(camera), np.array(camera.lever_arm_m), sources.origin
    assert origin is not None
    notes = (*log.notes, *gimbal_left_out(camera, log))
    found: FoundStart | None = None
    if camera.start == AUTO:
        found = auto_start(flight, camera, log, clock=clock, mount=mount, origin=origin, progress=progress)
        notes = (*notes, *found.notes)
    if camera.start is None and camera.telemetry == camera.video and np.isfinite(log.video_start_s):
        found = _video_start(log)
        notes = (*notes, *found.notes)
    if camera.tracks is None and camera.video is None:
        start, frame, left_out = _whole_log(flight, camera, log, rate)
        time = frame / rate
        notes = (*notes, *left_out)
    else:
        start = _start(flight, camera, log) if found is None else found.start_s
        frame, time = wanted_frames(camera, clock, rate, tracks)
    log_time_s, told = _log_times(camera, log, frame, start + log_seconds(log, time), time)

    def at(frames: Ints, log_time_s: Floats) -> PoseTrack:
        return camera_poses(
            log,
            camera=camera.name,
            frame=frames,
            log_time_s=log_time_s,
            mount=mount,
            lever_arm_m=lever,
            origin=origin,
            where=where,
        )

    utc = utc_at(log, start)
    span = (float(log_time_s.min()), float(log_time_s.max())) if len(log_time_s) else None
    sigma = sigma_in_force(camera, log_sigma(log, span), knows_utc=utc is not None)
    if not {"position_bias_m", "position_m"} <= set(camera.sigma):
        notes = (*notes, *position_worth(log, span).notes)
    if found is not None and found.sigma_s is not None and "start_s" not in camera.sigma:
        sigma = replace(sigma, start_s=found.sigma_s)
    elif camera.start == CAMERA_EVENT and "start_s" not in camera.sigma:
        sigma = replace(sigma, start_s=log.camera_event_sigma_s)
    return MeasuredPoses(
        camera=camera.name,
        poses=at(frame, log_time_s),
        frame_rate=rate,
        sigma=sigma,
        still=False,
        utc_s=utc,
        utc_sigma_s=None if log.utc is None else _utc_sigma_s(log.utc.sigma_s, found),
        poses_at=lambda base: lambda shift_s: at(base.frame, base.time_s + log_seconds(log, shift_s)),
        notes=(*notes, *told),
    )


def _log_times(
    camera: CameraSettings, log: FlightLog, frame: Ints, nominal_s: Floats, time_s: Floats
) -> tuple[Floats, tuple[str, ...]]:
    """Log times (n,) of frames (n,), and a note: each its own event's where `start` says so and the log has them."""
    own = event_times(log, frame, time_s) if camera.start == CAMERA_EVENT else None
    if own is None:
        return nominal_s, ()
    return own, (f"each frame is at its own {log.camera_event_source} of {log.path.name}",)


def _whole_log(
    flight: Flight, camera: CameraSettings, log: FlightLog, rate: float
) -> tuple[float, Ints, tuple[str, ...]]:
    """Start, and the frames that the log has poses for: a camera of which only the flight path is wanted."""
    begin, end = log_span(log)
    start = begin if camera.start is None else _start(flight, camera, log)
    long_s = (end - start) / float(log_seconds(log, np.ones(1))[0])
    frame = np.arange(int(long_s * rate) + 1)
    inside = covered(
        log, start + log_seconds(log, frame / rate), mount=_mount(camera), lever_arm_m=np.array(camera.lever_arm_m)
    )
    missing = int((~inside).sum())
    notes = (
        (f"{missing} of {len(frame)} moments left out, where the log has a gap",) if missing and inside.any() else ()
    )
    return start, frame[inside] if inside.any() else frame, notes


def _video_start(log: FlightLog) -> FoundStart:
    """Log time of frame 0 of the video that the log lies in."""
    start, sigma = log.video_start_s, log.video_start_sigma_s
    told = f"start by the time stamps beside the video in {log.path.name}: log time {start:.3f} s, sigma {sigma:.3f} s"
    return FoundStart(start_s=start, sigma_s=sigma, notes=(told,))


def _start(flight: Flight, camera: CameraSettings, log: FlightLog) -> float:
    where = flight.key(camera.name, "start")
    if camera.start is None:
        raise UsageError(
            where=where,
            seen="missing",
            expected="the log time of the video's frame 0",
            advice='write start = "auto" to find it by the camera\'s turning, "camera-event" where the log has camera '
            "events, seconds on the log's clock, or an ISO-8601 UTC time",
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
    frame, time = wanted_frames(camera, clock, rate, tracks)
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
    utc = utc_of_start(flight, camera)
    return MeasuredPoses(
        camera=camera.name,
        poses=at(frame, start + time),
        frame_rate=rate,
        sigma=sigma_in_force(camera, InstrumentSigma(), knows_utc=utc is not None),
        still=False,
        utc_s=utc,
        poses_at=poses_at,
    )


def _utc_sigma_s(log_sigma_s: float, found: FoundStart | None) -> float:
    """What UTC of frame 0 is worth: as the log and the match say, or a second where a person said when frame 0 was."""
    if found is None or found.sigma_s is None:
        return float(np.hypot(log_sigma_s, TYPED_START_S))
    return float(np.hypot(log_sigma_s, found.sigma_s))


def _mount(camera: CameraSettings) -> Mount:
    mount, correction = camera.mount, camera.mount_correction
    return Mount(
        yaw_rad=mount.yaw_rad,
        pitch_rad=mount.pitch_rad,
        roll_rad=mount.roll_rad,
        gimbal=mount.gimbal,
        correction_rad=(correction.yaw_rad, correction.pitch_rad, correction.roll_rad),
    )
