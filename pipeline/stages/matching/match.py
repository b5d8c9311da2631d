"""The tracks, poses and lenses of a flight as matching gets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.camera import CameraModel
from calibration.foundation.errors import UsageError
from calibration.foundation.progress import Progress, silent
from pipeline.flight import Flight
from pipeline.matching import Matching, MatchSettings, match_tracks
from pipeline.records import CameraInput, ImageTrack
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.build import camera_input
from pipeline.stages.problem.rays import check_inside, sight_rays


def match_flight(
    flight: Flight,
    tracks: Sequence[ImageTrack],
    measured: Sequence[MeasuredPoses],
    models: Mapping[str, CameraModel],
    progress: Progress = silent,
) -> Matching:
    """Which tracks of different cameras are of one target; names count for nothing, clocks as the flight knows them.

    Raises UsageError where fewer than two cameras have tracks, InputFileError where a fix is outside of its image.
    """
    inputs = [
        camera for pose in _reference_first(flight, measured)
        if (camera := _input(flight, pose, tracks, measured, models)) is not None
    ]  # fmt: skip
    if len(inputs) < 2:
        raise UsageError(
            where=str(flight.path),
            seen=f"tracks in {len(inputs)} camera{'s' if len(inputs) != 1 else ''}",
            expected="two cameras or more with tracks",
            advice="one camera has nothing to be matched with; check the boxes, tracks and videos of the others",
        )
    settings = MatchSettings(search_s=flight.solve.search_s)
    return match_tracks(inputs, settings, progress=lambda share: progress("match", int(100 * share), 100))


def _reference_first(flight: Flight, measured: Sequence[MeasuredPoses]) -> list[MeasuredPoses]:
    return sorted(measured, key=lambda pose: pose.camera != flight.reference_camera)


def _input(
    flight: Flight,
    pose: MeasuredPoses,
    tracks: Sequence[ImageTrack],
    measured: Sequence[MeasuredPoses],
    models: Mapping[str, CameraModel],
) -> CameraInput | None:
    own = [t for t in tracks if t.camera == pose.camera and t.seen.any()]
    if not own:
        return None
    check_inside(flight, models[pose.camera], own)
    rays, _ = sight_rays(models[pose.camera], pose.camera, own, tuple(t.target for t in own))
    return camera_input(flight, pose, rays, measured) if len(np.unique(rays.frame)) > 1 else None
