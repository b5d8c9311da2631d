"""What composes the rooms: a flight file becomes tracks, poses, a problem, a solution and its files.

Each stage is a function of the flight and of what came before; `run` chains them and resumes where it was stopped.
"""

from typing import TYPE_CHECKING

from calibration.foundation.on_demand import on_demand

if TYPE_CHECKING:
    from pipeline.stages.checks.outlook import Outlook
    from pipeline.stages.drafting.draft import Draft, draft_flight
    from pipeline.stages.drafting.landmarks import LandmarkDraft, LandmarkOptions, draft_landmarks
    from pipeline.stages.inputs.cameras import read_models
    from pipeline.stages.inputs.log_paths import log_paths
    from pipeline.stages.inputs.sources import open_sources
    from pipeline.stages.inputs.tracks import read_tracks, track_camera
    from pipeline.stages.poses.measure import measure_poses
    from pipeline.stages.poses.measured import MeasuredPoses
    from pipeline.stages.problem.build import build_problem
    from pipeline.stages.problem.rays import sight_rays
    from pipeline.stages.running.check import check_flight
    from pipeline.stages.running.flight import run_flight
    from pipeline.stages.running.ledger import Ledger, writing
    from pipeline.stages.running.match import MatchRun, run_match
    from pipeline.stages.running.poses import run_poses
    from pipeline.stages.running.provenance import decisive
    from pipeline.stages.running.recording import RecordingMade, record_flight
    from pipeline.stages.running.results import gather_results
    from pipeline.stages.running.solve import run_solve
    from pipeline.stages.running.summary import RunSummary
    from pipeline.stages.running.track import run_track
else:
    __getattr__ = on_demand(
        __name__,
        {
            "Draft": "drafting.draft",
            "LandmarkDraft": "drafting.landmarks",
            "LandmarkOptions": "drafting.landmarks",
            "Ledger": "running.ledger",
            "MatchRun": "running.match",
            "MeasuredPoses": "poses.measured",
            "Outlook": "checks.outlook",
            "RecordingMade": "running.recording",
            "RunSummary": "running.summary",
            "build_problem": "problem.build",
            "check_flight": "running.check",
            "decisive": "running.provenance",
            "draft_flight": "drafting.draft",
            "draft_landmarks": "drafting.landmarks",
            "gather_results": "running.results",
            "log_paths": "inputs.log_paths",
            "measure_poses": "poses.measure",
            "open_sources": "inputs.sources",
            "read_models": "inputs.cameras",
            "read_tracks": "inputs.tracks",
            "record_flight": "running.recording",
            "run_flight": "running.flight",
            "run_match": "running.match",
            "run_poses": "running.poses",
            "run_solve": "running.solve",
            "run_track": "running.track",
            "sight_rays": "problem.rays",
            "track_camera": "inputs.tracks",
            "writing": "running.ledger",
        },
    )

__all__ = [
    "Draft",
    "LandmarkDraft",
    "LandmarkOptions",
    "Ledger",
    "MatchRun",
    "MeasuredPoses",
    "Outlook",
    "RecordingMade",
    "RunSummary",
    "build_problem",
    "check_flight",
    "decisive",
    "draft_flight",
    "draft_landmarks",
    "gather_results",
    "log_paths",
    "measure_poses",
    "open_sources",
    "read_models",
    "read_tracks",
    "record_flight",
    "run_flight",
    "run_match",
    "run_poses",
    "run_solve",
    "run_track",
    "sight_rays",
    "track_camera",
    "writing",
]
