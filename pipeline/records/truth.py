"""What is true, where it is known: rendered flights, and flights measured by RTK."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.records.motion import Trajectory
from pipeline.records.poses import PoseTrack
from pipeline.records.tracks import ImageTrack


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """The true flight, in true common time (the reference camera's clock, frame 0 at 0).

    trajectories  sampled truth of each target; covariance zero
    offset_s, frame_rate  per camera
    poses         true camera poses per frame
    tracks        true image positions; lost where hidden
    """

    trajectories: tuple[Trajectory, ...]
    offset_s: Mapping[str, float]
    frame_rate: Mapping[str, float]
    poses: tuple[PoseTrack, ...] = ()
    tracks: tuple[ImageTrack, ...] = ()
    focal_px: Mapping[str, float] = field(default_factory=dict)
