"""A flight log as curves to be drawn."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.geometry.geodesy import enu_from_geodetic
from pipeline.records import LogPaths
from pipeline.telemetry import MAX_GAP_S, AttitudeSeries, FlightLog, GimbalSeries, first_position

MOST = 4000
"""Points of a curve: more cannot be seen."""


def log_paths(log: FlightLog) -> LogPaths:
    """The curves of a log; a gap that is not bridged breaks them, and what the log lacks is empty."""
    nothing = np.empty(0)
    place_s, enu = nothing, np.empty((0, 3))
    position = log.position
    if position is not None and position.valid.any():
        keep = position.valid
        enu = enu_from_geodetic(
            position.lat_rad[keep], position.lon_rad[keep], position.height_m[keep], first_position(log)
        )
        enu[:, 2] = position.height_m[keep]
        place_s, enu = _thinned(position.time_s[keep], enu)
    body_s, body = _angles(log.attitude)
    gimbal_s, gimbal = _angles(log.gimbal)
    return LogPaths(
        place_s=place_s, east_north_height_m=enu, body_s=body_s, body_ypr_rad=body, gimbal_s=gimbal_s,
        gimbal_ypr_rad=gimbal, event_s=log.camera_event_s,
    )  # fmt: skip


def _angles(series: AttitudeSeries | GimbalSeries | None) -> tuple[Floats, Floats]:
    if series is None or not series.valid.any():
        return np.empty(0), np.empty((0, 3))
    q = series.ned_from_body if isinstance(series, AttitudeSeries) else series.attitude
    keep = series.valid
    time_s, angle = _thinned(series.time_s[keep], rotation.yaw_pitch_roll(q[keep]))
    angle[1:][np.abs(np.diff(angle[:, 0])) > np.pi] = np.nan  # past north no line goes across the picture
    return time_s, angle


def _thinned(time_s: Floats, value: Floats) -> tuple[Floats, Floats]:
    """At most MOST points (n, k), NaN behind every gap."""
    broken = np.diff(time_s, prepend=time_s[:1]) > MAX_GAP_S
    every = max(1, -(-len(time_s) // MOST))
    keep = broken.copy()
    keep[::every] = True
    kept = np.array(value[keep])
    kept[broken[keep]] = np.nan
    return time_s[keep], kept
