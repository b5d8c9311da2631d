"""The frozen nouns that flow between the stages.

Each record is a keyword-only frozen dataclass of read-only float64 arrays, checked once when it is made. Missing
values are NaN, never zero. Nothing here reads a file, prints or computes more than a view of its own fields.
"""

from pipeline.records.ground import Ground, GroundAt, GroundHeights
from pipeline.records.landmarks import GroundFit, Landmark
from pipeline.records.motion import Motion, Trajectory
from pipeline.records.pictures import Film, GroundPicture, Picture, PictureKind
from pipeline.records.poses import InstrumentSigma, LogPaths, PoseTrack
from pipeline.records.problem import CameraInput, Problem, SolverSettings, SurveyedPlace, TargetInput
from pipeline.records.rays import SightRays
from pipeline.records.results import Comparison, Results
from pipeline.records.solution import (
    Bias,
    Clock,
    Finding,
    OffsetCandidate,
    Redundancy,
    Sightings,
    Solution,
    SolveStatus,
    UnitWeight,
)
from pipeline.records.tracks import (
    LOST,
    REACQUIRED,
    STATE_NAMES,
    TRACKED,
    TRACKERS,
    Box,
    ImageTrack,
    TrackerName,
)
from pipeline.records.truth import Truth
from pipeline.records.verdict import GRADES, Correction, DepthRange, Grade, Reason, Verdict, worst

__all__ = [
    "GRADES",
    "LOST",
    "REACQUIRED",
    "STATE_NAMES",
    "TRACKED",
    "TRACKERS",
    "Bias",
    "Box",
    "CameraInput",
    "Clock",
    "Comparison",
    "Correction",
    "DepthRange",
    "Film",
    "Finding",
    "Grade",
    "Ground",
    "GroundAt",
    "GroundFit",
    "GroundHeights",
    "GroundPicture",
    "ImageTrack",
    "InstrumentSigma",
    "Landmark",
    "LogPaths",
    "Motion",
    "OffsetCandidate",
    "Picture",
    "PictureKind",
    "PoseTrack",
    "Problem",
    "Reason",
    "Redundancy",
    "Results",
    "SightRays",
    "Sightings",
    "Solution",
    "SolveStatus",
    "SolverSettings",
    "SurveyedPlace",
    "TargetInput",
    "TrackerName",
    "Trajectory",
    "Truth",
    "UnitWeight",
    "Verdict",
    "worst",
]
