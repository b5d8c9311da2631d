"""A simulator's truth in a log (ArduPilot's SIM and SIMSTATE), held against what the log claims of itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.geometry import rotation
from pipeline.telemetry.camera_pose.interpolate import MAX_GAP_S
from pipeline.telemetry.camera_pose.sigma import log_sigma
from pipeline.telemetry.gimbals.frames import attitude_at
from pipeline.telemetry.log.flight_log import FlightLog
from pipeline.telemetry.log.series import METRES_PER_DEGREE


@dataclass(frozen=True, kw_only=True)
class PoseError:
    """Root mean squares per axis of the log's poses minus the truth; NaN where the log or the truth lacks them.

    in_sigmas  the same over what `log_sigma` claims: constant and moving part together, position and attitude
    """

    position_m: float
    attitude_rad: float
    in_sigmas: tuple[float, float]


def pose_error(log: FlightLog) -> PoseError | None:
    """How far the log's positions and attitudes are from the simulator's; None where there is no truth in it."""
    if log.truth is None:
        return None
    sigma = log_sigma(log)
    place, turn = _position_m(log), _attitude_rad(log)
    claimed = (np.hypot(sigma.position_bias_m, sigma.position_m), np.hypot(sigma.attitude_bias_rad, sigma.attitude_rad))
    return PoseError(
        position_m=place, attitude_rad=turn, in_sigmas=(place / float(claimed[0]), turn / float(claimed[1]))
    )


def truth_words(log: FlightLog) -> tuple[str, ...]:
    """One line on the pose error, where there is a truth."""
    found = pose_error(log)
    if found is None or log.truth is None:
        return ()
    return (
        f"the simulator's truth ({log.truth.source}): positions off by {found.position_m:.2f} m an axis,"
        f" {found.in_sigmas[0]:.2f} of the claimed sigma; attitudes by {np.degrees(found.attitude_rad):.2f} degrees,"
        f" {found.in_sigmas[1]:.2f} of it",
    )


def _position_m(log: FlightLog) -> float:
    truth, position = log.truth, log.position
    if truth is None or position is None:
        return float("nan")
    keep = position.valid
    time = position.time_s[keep]
    stamp = truth.time_s
    known = np.isfinite(stamp + truth.lat_rad + truth.lon_rad)
    inside = _beside(stamp[known], time)
    if not inside.any():
        return float("nan")
    north, east, up = (
        scale * (own[keep] - np.interp(time, stamp[known], true[known]))[inside]
        for own, true, scale in (
            (position.lat_rad, truth.lat_rad, np.degrees(METRES_PER_DEGREE)),
            (position.lon_rad, truth.lon_rad, np.degrees(METRES_PER_DEGREE) * np.cos(np.median(truth.lat_rad[known]))),
            (position.height_m, truth.height_m, 1.0),
        )
    )
    axes = [axis for axis in (north, east, up) if np.isfinite(axis).all()]
    return float(np.sqrt(np.mean(np.square(axes))))


def _attitude_rad(log: FlightLog) -> float:
    truth, attitude = log.truth, log.attitude
    if truth is None or attitude is None:
        return float("nan")
    keep = attitude.valid
    true, inside = attitude_at(truth.attitude, attitude.time_s[keep])
    inside &= _beside(truth.attitude.time_s[truth.attitude.valid], attitude.time_s[keep])
    if not inside.any():
        return float("nan")
    apart = rotation.multiply(rotation.conjugate(true[inside]), attitude.ned_from_body[keep][inside])
    return float(np.sqrt(np.mean(rotation.log(apart) ** 2)))


def _beside(stamp_s: Floats, time_s: Floats) -> Bools:
    """True (n,) for times that lie inside the truth, and in no gap of it."""
    if len(stamp_s) < 2:
        return np.zeros(len(time_s), dtype=np.bool_)
    after = np.clip(np.searchsorted(stamp_s, time_s), 1, len(stamp_s) - 1)
    near = stamp_s[after] - stamp_s[after - 1] <= MAX_GAP_S
    return np.asarray(near & (time_s >= stamp_s[0]) & (time_s <= stamp_s[-1]))
