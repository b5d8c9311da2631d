"""Which frames a camera has, and their video times.

Video time is the container's timestamp counted from frame 0; where the flight file gives a frame rate, the container's
clock is scaled to it. Without a video it is frame / frame rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle
from calibration.foundation.capture import FrameIndex
from calibration.foundation.errors import UsageError
from pipeline.flight import CameraSettings, Flight
from pipeline.tracking import VideoTimes, indexed_times


@dataclass(frozen=True, kw_only=True, eq=False)
class VideoClock:
    """The times of a video's frames: `time_s` (n,) from frame 0 at the nominal `frame_rate`."""

    time_s: Floats
    frame_rate: float

    def __post_init__(self) -> None:
        settle(self, time_s=frozen(self.time_s, (None,), "time_s"))


def video_clock(camera: CameraSettings) -> VideoClock | None:
    """The clock of a camera's video, or None where it has none."""
    if camera.video is None:
        return None
    return scaled_clock(video_index(camera)[0], camera.frame_rate)


def video_index(camera: CameraSettings) -> tuple[VideoTimes, FrameIndex]:
    """The times of a camera's video as its container has them, and where each frame is found; read once in a run.

    Raises InputFileError where there is no video.
    """
    assert camera.video is not None
    changed_ns = camera.video.stat().st_mtime_ns if camera.video.exists() else 0
    return _indexed(camera.video, camera.video_stream, changed_ns)


@lru_cache(maxsize=16)
def _indexed(video: Path, stream: int | None, changed_ns: int) -> tuple[VideoTimes, FrameIndex]:
    return indexed_times(video, stream)


def scaled_clock(times: VideoTimes, frame_rate: float | None) -> VideoClock:
    """The container's times at the frame rate that the flight file gives, if it gives one."""
    rate = frame_rate or times.frame_rate
    return VideoClock(time_s=times.frame_time_s * (times.frame_rate / rate), frame_rate=rate)


def frame_rate(flight: Flight, camera: CameraSettings, clock: VideoClock | None) -> float:
    """The nominal frame rate: the flight file's, else the container's.

    Raises UsageError where neither says.
    """
    if camera.frame_rate is not None:
        return camera.frame_rate
    if clock is None:
        raise UsageError(
            where=flight.key(camera.name, "frame_rate"),
            seen="missing, and there is no video to ask",
            expected="frames per second",
            advice="write frame_rate = 25.0, as the camera's maker states it",
        )
    return clock.frame_rate


def video_time_s(frame: Ints, rate: float, clock: VideoClock | None) -> Floats:
    """Video times (n,) of frames (n,)."""
    if clock is None or not len(frame):
        return np.asarray(frame / rate)
    inside = np.clip(frame, 0, len(clock.time_s) - 1)
    return np.asarray(clock.time_s[inside] + (frame - inside) / rate)
