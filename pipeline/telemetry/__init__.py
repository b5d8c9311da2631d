"""Stage 3: flight logs become camera poses (`read_log`, `resolve_start`, `camera_poses`)."""

from pipeline.telemetry.camera_pose import MAX_GAP_S, Mount, camera_poses, covered
from pipeline.telemetry.flight_log import (
    Accuracy,
    AttitudeSeries,
    ClockFit,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.inspection import Inspection, inspect_log
from pipeline.telemetry.log_sigma import log_sigma
from pipeline.telemetry.log_time import first_position, log_span, resolve_start, utc_at
from pipeline.telemetry.pose_table import PoseTable, read_pose_table, table_poses
from pipeline.telemetry.read import read_log

__all__ = [
    "MAX_GAP_S",
    "Accuracy",
    "AttitudeSeries",
    "ClockFit",
    "FlightLog",
    "GimbalSeries",
    "Inspection",
    "Mount",
    "PoseTable",
    "PositionSeries",
    "camera_poses",
    "covered",
    "first_position",
    "inspect_log",
    "log_sigma",
    "log_span",
    "read_log",
    "read_pose_table",
    "resolve_start",
    "table_poses",
    "utc_at",
]
