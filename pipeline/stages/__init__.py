"""What composes the rooms: a flight file becomes tracks, poses, a problem, a solution and its files.

Each stage is a function of the flight and of what came before; `run` chains them and resumes where it was stopped.
"""

from pipeline.stages.log_paths import log_paths
from pipeline.stages.measured import MeasuredPoses
from pipeline.stages.poses import measure_poses
from pipeline.stages.problem import build_problem, read_models, sight_rays
from pipeline.stages.results import gather_results
from pipeline.stages.run import RunSummary, run_flight, run_poses, run_solve, run_track
from pipeline.stages.sources import open_sources
from pipeline.stages.tracks import read_tracks, track_camera

__all__ = [
    "MeasuredPoses",
    "RunSummary",
    "build_problem",
    "gather_results",
    "log_paths",
    "measure_poses",
    "open_sources",
    "read_models",
    "read_tracks",
    "run_flight",
    "run_poses",
    "run_solve",
    "run_track",
    "sight_rays",
    "track_camera",
]
