"""Stage 3: flight logs become camera poses (`read_log`, `resolve_start`, `camera_poses`)."""

from pipeline.telemetry.camera_pose.from_log import Mount, camera_poses, covered
from pipeline.telemetry.camera_pose.from_table import PoseTable, is_pose_table, read_pose_table, table_poses
from pipeline.telemetry.camera_pose.interpolate import MAX_GAP_S
from pipeline.telemetry.camera_pose.sigma import log_sigma, position_worth
from pipeline.telemetry.clocks.own_clock import log_seconds
from pipeline.telemetry.excerpts.excerpt import Excerpt
from pipeline.telemetry.heights.takeoff import with_takeoff
from pipeline.telemetry.inspection import Inspection, inspect_log
from pipeline.telemetry.log.flight_log import (
    Accuracy,
    AttitudeSeries,
    ClockModel,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.read import read_log
from pipeline.telemetry.video_start.log_time import event_times, first_position, log_span, resolve_start, utc_at
from pipeline.telemetry.video_start.turn_match import GRID_S, Candidate, LogTurning, Match, match_turns

__all__ = [
    "GRID_S",
    "MAX_GAP_S",
    "Accuracy",
    "AttitudeSeries",
    "Candidate",
    "ClockModel",
    "Excerpt",
    "FlightLog",
    "GimbalSeries",
    "Inspection",
    "LogTurning",
    "Match",
    "Mount",
    "PoseTable",
    "PositionSeries",
    "camera_poses",
    "covered",
    "event_times",
    "first_position",
    "inspect_log",
    "is_pose_table",
    "log_seconds",
    "log_sigma",
    "log_span",
    "match_turns",
    "position_worth",
    "read_log",
    "read_pose_table",
    "resolve_start",
    "table_poses",
    "utc_at",
    "with_takeoff",
]
