"""Stage 3: flight logs become camera poses (`read_log`, `resolve_start`, `camera_poses`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibration.foundation.on_demand import on_demand

if TYPE_CHECKING:
    from pipeline.telemetry.camera_pose.from_log import Mount, camera_poses, covered
    from pipeline.telemetry.camera_pose.from_table import PoseTable, is_pose_table, read_pose_table, table_poses
    from pipeline.telemetry.camera_pose.interpolate import MAX_GAP_S
    from pipeline.telemetry.camera_pose.sigma import log_sigma, position_worth
    from pipeline.telemetry.clocks.own_clock import log_seconds
    from pipeline.telemetry.excerpts.excerpt import Excerpt
    from pipeline.telemetry.heights.geoid import geoid_height_m
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
else:  # each is loaded when it is asked for: a log of one format needs no reader of another
    __getattr__ = on_demand(
        __name__,
        {
            "GRID_S": "video_start.turn_match",
            "MAX_GAP_S": "camera_pose.interpolate",
            "Accuracy": "log.flight_log",
            "AttitudeSeries": "log.flight_log",
            "Candidate": "video_start.turn_match",
            "ClockModel": "log.flight_log",
            "Excerpt": "excerpts.excerpt",
            "FlightLog": "log.flight_log",
            "GimbalSeries": "log.flight_log",
            "Inspection": "inspection",
            "LogTurning": "video_start.turn_match",
            "Match": "video_start.turn_match",
            "Mount": "camera_pose.from_log",
            "PoseTable": "camera_pose.from_table",
            "PositionSeries": "log.flight_log",
            "camera_poses": "camera_pose.from_log",
            "covered": "camera_pose.from_log",
            "event_times": "video_start.log_time",
            "first_position": "video_start.log_time",
            "geoid_height_m": "heights.geoid",
            "inspect_log": "inspection",
            "is_pose_table": "camera_pose.from_table",
            "log_seconds": "clocks.own_clock",
            "log_sigma": "camera_pose.sigma",
            "log_span": "video_start.log_time",
            "match_turns": "video_start.turn_match",
            "position_worth": "camera_pose.sigma",
            "read_log": "read",
            "read_pose_table": "camera_pose.from_table",
            "resolve_start": "video_start.log_time",
            "table_poses": "camera_pose.from_table",
            "utc_at": "video_start.log_time",
            "with_takeoff": "heights.takeoff",
        },
    )

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
    "geoid_height_m",
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
