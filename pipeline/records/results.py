"""Everything that the exports and the report draw from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pipeline.geometry.geodesy import Geodetic
from pipeline.records.motion import Trajectory
from pipeline.records.pictures import Film, GroundPicture, Picture
from pipeline.records.poses import PoseTrack
from pipeline.records.solution import Solution
from pipeline.records.tracks import ImageTrack
from pipeline.records.truth import Truth


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One row of a comparison with the truth: an error before and after the adjustment, and the claimed sigma.

    before, after, sigma  in `unit`; NaN where there is no such figure
    """

    what: str
    unit: str
    before: float
    after: float
    sigma: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Results:
    """A solved flight with all that belongs to it.

    title           name of the flight, for people
    solution        the adjustment
    trajectories    its motions, evenly sampled
    tracks          the image tracks that went in
    measured_poses  the camera poses that went in (the refined ones are `solution.poses`)
    image_size      (width, height) in pixels of each camera
    origin          of the local ENU frame; None: not on the map, so nothing can be exported to one
    utc_s           UTC (POSIX seconds) at common time 0; None where no log knows it
    inputs          file name as the flight file gives it -> SHA-256
    settings        in force, as plain values
    versions        package -> version
    warnings        one sentence each
    typical_sigma_m median over the well known part of each trajectory of its 3D position's sigma, by target
    pictures        moments of the videos, the most important first; picture_notes  why some or all are missing
    films           frames of the videos over the whole flight, small
    ground_pictures the ground from above, one for each map of the report
    truth, comparison  where the truth is known
    """

    title: str
    solution: Solution
    trajectories: tuple[Trajectory, ...]
    tracks: tuple[ImageTrack, ...]
    measured_poses: tuple[PoseTrack, ...]
    image_size: Mapping[str, tuple[int, int]]
    origin: Geodetic | None
    utc_s: float | None
    inputs: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    typical_sigma_m: Mapping[str, float] = field(default_factory=dict)
    pictures: tuple[Picture, ...] = ()
    picture_notes: tuple[str, ...] = ()
    films: tuple[Film, ...] = ()
    ground_pictures: tuple[GroundPicture, ...] = ()
    truth: Truth | None = None
    comparison: tuple[Comparison, ...] = ()
