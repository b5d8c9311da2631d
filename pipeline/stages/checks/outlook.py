"""All that can be seen before tracking, of one flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from calibration.camera import CameraModel
from calibration.foundation.errors import RunningFixError
from pipeline.flight import AUTO, Flight
from pipeline.stages.checks.doubt import Doubt
from pipeline.stages.checks.looks import look_doubts
from pipeline.stages.checks.meeting import Expected, expected_sigmas, sight_doubts
from pipeline.stages.checks.settings import setting_doubts
from pipeline.stages.checks.videos import video_doubts
from pipeline.stages.checks.views import time_doubts, view_doubts
from pipeline.stages.inputs.sources import Sources
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.tracking import VideoTimes, video_times

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlook:
    """What a flight looks like before tracking.

    doubts    what is wrong or likely so, certain ones first
    errors    what stops commands anyway, as they would say it
    expected  what positions can be worth, by the first boxes
    """

    doubts: tuple[Doubt, ...] = ()
    errors: tuple[RunningFixError, ...] = ()
    expected: tuple[Expected, ...] = ()


def outlook(
    flight: Flight,
    models: Mapping[str, CameraModel],
    videos: Mapping[str, VideoTimes],
    sources: Sources,
    measured: Sequence[MeasuredPoses],
) -> Outlook:
    """Every check of a flight whose files are open; what is not known yet (`measured` empty) is left out."""
    doubts = [
        *video_doubts(flight, videos),
        *setting_doubts(flight, sources),
        *time_doubts(flight, measured),
        *sight_doubts(flight, measured, models),
        *view_doubts(flight, measured, models),
        *(look_doubts(flight) if videos else ()),
    ]
    return Outlook(
        doubts=tuple(sorted(doubts, key=lambda doubt: not doubt.certain)),
        expected=tuple(expected_sigmas(flight, measured, models)),
    )


def look_ahead(
    flight: Flight,
    models: Callable[[], Mapping[str, CameraModel]],
    measure: Callable[[], tuple[Sources, Sequence[MeasuredPoses]]],
) -> Outlook:
    """The outlook of a flight, going on past what is wrong: every error is gathered, and what it hides is left out.

    Poses are not measured where `start` has to be found in a video: that takes as long as tracking.
    """
    errors: list[RunningFixError] = []
    found = _tried(models, errors) or {}
    videos = {}
    for camera in flight.cameras:
        if camera.video is not None:
            times = _tried(partial(video_times, camera.video, camera.video_stream), errors)
            if times is not None:
                videos[camera.name] = times
    nothing = Sources(logs={}, tables={}, origin=None)
    quick = not any(camera.start == AUTO for camera in flight.cameras)
    sources, measured = (_tried(measure, errors) if quick else None) or (nothing, ())
    seen = outlook(flight, found, videos, sources, measured if found else ())
    return Outlook(doubts=seen.doubts, errors=tuple(errors), expected=seen.expected)


def refuse(found: Outlook) -> None:
    """Raises the first of what commands cannot go on with."""
    for error in (*found.errors, *(doubt.error() for doubt in found.doubts if doubt.certain)):
        raise error


def _tried(action: Callable[[], T], errors: list[RunningFixError]) -> T | None:
    try:
        return action()
    except RunningFixError as error:
        errors.append(error)
        return None
