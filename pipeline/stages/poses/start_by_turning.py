"""`start = "auto"`: the log time of frame 0, from the camera's turning in the picture and in the log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError, UsageError
from calibration.foundation.progress import Progress
from pipeline.flight import CameraSettings, Flight, VideoArea
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import Geodetic
from pipeline.stages.inputs.cameras import fitting_model
from pipeline.stages.inputs.frames import VideoClock
from pipeline.telemetry import GRID_S, FlightLog, LogTurning, Match, Mount, camera_poses, covered, log_span, match_turns
from pipeline.tracking import ImageTurning, image_turning

LEAST_DOWN = 0.1


@dataclass(frozen=True, kw_only=True)
class FoundStart:
    """Log time of frame 0, one sigma (None where it was given, not found), and what to say of it."""

    start_s: float
    sigma_s: float | None = None
    notes: tuple[str, ...] = ()


def auto_start(
    flight: Flight,
    camera: CameraSettings,
    log: FlightLog,
    *,
    clock: VideoClock | None,
    mount: Mount,
    origin: Geodetic,
    progress: Progress,
) -> FoundStart:
    """The start of a camera's video on its log's clock.

    Raises UsageError without a video, GeometryError where there is no rotation to match or several starts fit.
    """
    where = flight.key(camera.name, "start")
    if camera.video is None or clock is None:
        raise UsageError(
            where=where,
            seen='"auto" without a video',
            expected="a video, whose picture shows how the camera turned",
            advice='give the video, or write start = "camera-event", seconds on the log\'s clock or a UTC time',
        )
    seen = _turning(
        camera.video,
        camera.video_stream,
        camera.calibration,
        camera.video_area,
        flight.key(camera.name, "calibration"),
        camera.video.stat().st_mtime_ns,
        _Tell(camera.name, progress),
    )
    log_turns = log_turning(log, mount, np.array(camera.lever_arm_m), origin, where)
    match = match_turns(clock.time_s[: len(seen.frame_time_s)], seen.turn_rad[: len(clock.time_s) - 1], log_turns)
    if not match.certain:
        raise _refused(match, where, log)
    best = match.candidates[0]
    note = (
        f"start = {best.start_s:.3f} s of log time, one sigma {best.sigma_s:.3f} s, by the camera's turning"
        f" (correlation {best.correlation:.2f}, odds exp({best.evidence:.0f}) against chance)"
    )
    return FoundStart(start_s=best.start_s, sigma_s=best.sigma_s, notes=(note,))


class _Tell:
    """A listener that any other is equal to: what is heard does not change what is measured."""

    def __init__(self, camera: str, progress: Progress) -> None:
        self.camera, self.progress = camera, progress

    def __call__(self, done: int, total: int) -> None:
        self.progress(f"turning {self.camera}", done, total)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Tell)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=16)
def _turning(
    video: Path, stream: int | None, calibration: Path, area: VideoArea | None, where: str, changed_ns: int, tell: _Tell
) -> ImageTurning:
    """The turning of a video, measured once in a run."""
    return image_turning(video, fitting_model(calibration, video, area, where, stream), tell, stream)


def log_turning(log: FlightLog, mount: Mount, lever_arm_m: Floats, origin: Geodetic, where: str) -> LogTurning:
    """How the camera turned and moved by its log, wherever the log says it; raises as `camera_poses`.

    Over level ground with normal n (down, camera axes) the picture's homography is R - t n' / d, so that a movement t
    shows as a swing (t_y, -t_x) n_z / d and as a spin (t_x n_y - t_y n_x) / 2 d.
    """
    begin, end = log_span(log)
    time = np.asarray(begin + GRID_S * np.arange(int((end - begin) / GRID_S) + 1), float)
    inside = covered(log, time, mount=mount, lever_arm_m=lever_arm_m)
    used = np.flatnonzero(inside) if inside.any() else np.arange(len(time))  # none: let the error say what is missing
    poses = camera_poses(
        log, camera="", frame=used, log_time_s=time[used], mount=mount, lever_arm_m=lever_arm_m, origin=origin,
        where=where,
    )  # fmt: skip
    place, attitude = np.full((len(time), 3), np.nan), np.full((len(time), 4), np.nan)
    place[used], attitude[used] = poses.position_enu_m, poses.enu_from_cam
    turn = rotation.turn(attitude[1:], attitude[:-1])
    moved = rotation.rotate(rotation.conjugate(attitude[:-1]), np.diff(place, axis=0))
    down = rotation.rotate(rotation.conjugate(attitude[:-1]), np.array([0.0, 0.0, -1.0]))
    with np.errstate(invalid="ignore"):
        ahead = np.where(down[:, 2] > LEAST_DOWN, down[:, 2], np.inf)  # level with the horizon: no ground in the middle
    spin = 0.5 * (moved[:, 0] * down[:, 1] - moved[:, 1] * down[:, 0]) / ahead
    shift = np.stack([moved[:, 1], -moved[:, 0], np.where(np.isnan(moved[:, 0]), np.nan, spin)], axis=1)
    return LogTurning(begin_s=begin, rate_radps=turn / GRID_S, shift_mps=shift / GRID_S)


def _refused(match: Match, where: str, log: FlightLog) -> GeometryError:
    advice = 'write start = 123.4 (seconds on the log\'s clock), a UTC time, or "camera-event"'
    turned = f"the picture turns by {match.turning_deg:.2f} degrees per second (root mean square)"
    if not match.candidates or match.candidates[0].evidence < match.needed:
        best = match.candidates[0] if match.candidates else None
        said = "" if best is None else f"; the best start, {best.start_s:.3f} s, could be chance"
        return GeometryError(
            where=where,
            seen=f"no rotation in the video that {log.path.name} matches: {turned}{said}",
            expected="a video taken during the log, in which the camera turns now and then",
            advice=advice,
        )
    starts = ", ".join(f"{c.start_s:.3f} s (correlation {c.correlation:.2f})" for c in match.candidates)
    return GeometryError(
        where=where,
        seen=f"{len(match.candidates)} starts fit about as well: {starts}; {turned}",
        expected="one start that fits best",
        advice=f"{advice}; one of these may be it",
    )
