"""What every source of poses comes to, and what they share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import UsageError
from pipeline.flight import AUTO, CAMERA_EVENT, CameraSettings, Flight
from pipeline.records import ImageTrack, InstrumentSigma, PoseTrack
from pipeline.records.problem import PoseAt
from pipeline.stages.inputs.frames import VideoClock, video_time_s


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPoses:
    """One camera's measured poses and what the instruments say of them.

    frame_rate  nominal, Hz
    utc_s       UTC of frame 0 where it is known, and utc_sigma_s how well
    poses_at    poses at frames' log times moved by (n,) seconds, where they came from a log
    notes       what a reader should know
    """

    camera: str
    poses: PoseTrack
    frame_rate: float
    sigma: InstrumentSigma
    still: bool
    utc_s: float | None = None
    utc_sigma_s: float | None = None
    poses_at: Callable[[PoseTrack], PoseAt] | None = None
    notes: tuple[str, ...] = ()


def wanted_frames(
    camera: CameraSettings, clock: VideoClock | None, rate: float, tracks: tuple[ImageTrack, ...]
) -> tuple[Ints, Floats]:
    """Frames and video times (n,) of a camera: of its video, else of its detections, else none."""
    if clock is not None:
        frame = np.arange(len(clock.time_s))
        return frame, video_time_s(frame, rate, clock)
    own = [t for t in tracks if t.camera == camera.name]
    if not own:
        return np.zeros(0, np.int64), np.zeros(0)
    frame, first = np.unique(np.concatenate([t.frame for t in own]), return_index=True)
    return frame, np.concatenate([t.time_s for t in own])[first]


def utc_of_start(flight: Flight, camera: CameraSettings) -> float | None:
    """UTC of frame 0 where the flight file itself says it."""
    if not isinstance(camera.start, str):
        return None
    if camera.start in (CAMERA_EVENT, AUTO):
        raise UsageError(
            where=flight.key(camera.name, "start"),
            seen=f'"{camera.start}" without a log',
            expected="a UTC time for a camera that has no log",
            advice='write start = "2025-06-01T09:30:00Z", or leave it out',
        )
    when = datetime.fromisoformat(camera.start)
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def sigma_in_force(camera: CameraSettings, default: InstrumentSigma, *, knows_utc: bool) -> InstrumentSigma:
    """What the flight file gives, else the instruments' own words; an offset has a prior only where it is known."""
    given = {f.name: camera.sigma[f.name] for f in fields(InstrumentSigma) if f.name in camera.sigma}
    if camera.offset_s is None and not knows_utc:
        given.pop("offset_s", None)
    elif camera.offset_s is None and "offset_s" not in given:
        given["offset_s"] = 1.0
    return replace(default, **given)
