"""Errors against the truth, before and after the adjustment.

Before: what is known without it. Positions by `intersection` on the given clocks, the clocks as given, the poses as
measured. After: the solution. Times are common time, which is the truth's own where the reference camera is the same.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import Comparison, Motion, PoseTrack, Results, Solution, Trajectory, Truth


def compare(results: Results, before: Solution, truth: Truth) -> tuple[Comparison, ...]:
    """One row for each target, offset, frame rate and camera attitude."""
    return (*_positions(results, before, truth), *_clocks(results, before, truth), *_attitudes(results, truth))


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(error) ** 2, axis=-1))))


def true_position(truth: Trajectory, time_s: Floats) -> Floats:
    """True positions (n, 3) at common times (n,), by a cubic through the samples."""
    return np.asarray(CubicSpline(truth.time_s, truth.position_enu_m)(time_s))


def position_error(found: Trajectory, truth: Trajectory) -> Floats:
    """Found minus true (n, 3), at the found trajectory's times that the truth covers."""
    inside = (found.time_s >= truth.time_s[0]) & (found.time_s <= truth.time_s[-1])
    return np.asarray(found.position_enu_m[inside] - true_position(truth, found.time_s[inside]))


def _positions(results: Results, before: Solution, truth: Truth) -> list[Comparison]:
    rows = []
    for found in results.trajectories:
        true = next(t for t in truth.trajectories if t.target == found.target)
        first: Motion = before.motion(found.target)
        rows.append(
            Comparison(
                what=f"position of {found.target}",
                unit="m",
                before=_rms(first.position_enu_m(found.time_s) - true_position(true, found.time_s)),
                after=_rms(position_error(found, true)),
                sigma=_rms(found.sigma_m[:, None]),
            )
        )
    return rows


def _clocks(results: Results, before: Solution, truth: Truth) -> list[Comparison]:
    rows = []
    for clock in results.solution.clocks[1:]:
        given = before.clock(clock.camera)
        offset, rate = truth.offset_s[clock.camera], truth.frame_rate[clock.camera]
        rows += [
            Comparison(
                what=f"time offset of {clock.camera}",
                unit="ms",
                before=1e3 * abs(given.offset_s - offset),
                after=1e3 * abs(clock.offset_s - offset),
                sigma=1e3 * clock.offset_sigma_s,
            ),
            Comparison(
                what=f"frame rate of {clock.camera}",
                unit="mHz",
                before=1e3 * abs(clock.nominal_rate - rate),
                after=1e3 * abs(clock.frame_rate - rate),
                sigma=1e3 * clock.frame_rate_sigma,
            ),
        ]
    return rows


def attitude_error_rad(found: PoseTrack, true: PoseTrack) -> Floats:
    """Rotation vectors (n, 3) from the true to the found attitude, at the frames both have."""
    _, mine, theirs = np.intersect1d(found.frame, true.frame, return_indices=True)
    return rotation.turn(true.enu_from_cam[theirs], found.enu_from_cam[mine])


def _attitudes(results: Results, truth: Truth) -> list[Comparison]:
    rows = []
    measured = {p.camera: p for p in results.measured_poses}
    biases = {b.camera: b for b in results.solution.biases}
    for refined in results.solution.poses:
        true = next((p for p in truth.poses if p.camera == refined.camera), None)
        if true is None:
            continue
        bias = biases.get(refined.camera)
        before, after = (
            float(np.degrees(_rms(attitude_error_rad(poses, true)))) for poses in (measured[refined.camera], refined)
        )
        sigma = float(np.degrees(np.linalg.norm(bias.rotation_sigma_rad))) if bias else float("nan")
        rows.append(
            Comparison(what=f"attitude of {refined.camera}", unit="deg", before=before, after=after, sigma=sigma)
        )
    return rows
