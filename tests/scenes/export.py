"""Small results with something of everything: awkward names, a gap in knowledge, a drifting clock."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from pipeline.geometry.geodesy import Geodetic
from pipeline.records import (
    LOST,
    REACQUIRED,
    TRACKED,
    Bias,
    Clock,
    Finding,
    ImageTrack,
    Motion,
    OffsetCandidate,
    PoseTrack,
    Results,
    Sightings,
    Solution,
    Trajectory,
)

VAN, BUS = 'van <1> & "co", Zürich', "bus"
ORIGIN = Geodetic.from_degrees(47.4, 8.5, 500.0)
UTC_S = 1740830400.0  # 2025-03-01T12:00:00Z
LEVEL = [0.5, -0.5, 0.5, -0.5]


def covariance_band(p: int, degree: int) -> np.ndarray:
    """A band whose every position covariance is positive definite."""
    band = np.zeros((p, degree + 1, 3, 3))
    band[:, 0] = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.16]])
    band[: p - 1, 1] = np.array([[0.004, 0.001, 0.002], [0.0, 0.009, 0.0], [0.001, 0.0, 0.016]])
    return band


def motions() -> tuple[Motion, ...]:
    """A straight line whose covariance is known, and a spline of which it is not."""
    line = Motion(
        target=BUS,
        kind="polynomial",
        degree=1,
        knots_s=np.array([1.0, 1.0, 3.0, 3.0]),
        coefficients=np.array([[10.0, -20.0, 0.5], [30.0, -10.0, 0.25]]),
        covariance_band=covariance_band(2, 1),
        start_s=1.0,
        end_s=3.0,
    )
    curve = Motion(
        target=VAN,
        kind="spline",
        degree=2,
        knots_s=np.array([0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0]),
        coefficients=np.array([[0.0, 0.0, 1.0], [5.0, 1.0, 1.0], [12.0, 3.0, 1.5], [20.0, 8.0, 1.25]]),
        start_s=0.0,
        end_s=2.0,
    )
    return line, curve


def sampled(motion: Motion, rate_hz: float = 2.0) -> Trajectory:
    time = np.arange(motion.start_s, motion.end_s + 1e-9, 1 / rate_hz)
    return Trajectory(
        target=motion.target,
        time_s=time,
        position_enu_m=motion.position_enu_m(time),
        velocity_mps=motion.position_enu_m(time, 1),
        covariance=motion.position_covariance(time),
    )


def tracks() -> tuple[ImageTrack, ...]:
    hidden = ImageTrack(
        camera="uav1",
        target=VAN,
        frame=np.array([0, 1, 2, 5]),
        time_s=np.array([0.0, 0.04, 0.08, 0.2]),
        xy_px=np.array([[100.1, 200.25], [1 / 3, 2e-17], [np.nan, np.nan], [640.0, 0.0]]),
        sigma_px=np.array([0.5, 0.1 + 0.2, np.nan, 1.0]),
        state=np.array([TRACKED, TRACKED, LOST, REACQUIRED]),
    )
    plain = ImageTrack(
        camera="uav2",
        target=BUS,
        frame=np.array([3]),
        time_s=np.array([0.12]),
        xy_px=np.array([[1.5, 2.5]]),
        sigma_px=np.array([1.0]),
        state=np.array([TRACKED]),
    )
    return hidden, plain


def poses(shift_m: float = 0.0) -> tuple[PoseTrack, ...]:
    """A camera that stands and one that flies north."""
    still = PoseTrack(
        camera="uav1",
        frame=np.arange(3),
        time_s=np.arange(3) / 25,
        position_enu_m=np.tile([0.0, 0.0, 2.0 + shift_m], (3, 1)),
        enu_from_cam=np.tile(LEVEL, (3, 1)),
    )
    flying = PoseTrack(
        camera="uav2",
        frame=np.array([0, 25, 50]),
        time_s=np.array([100.0, 101.0, 102.0]),
        position_enu_m=np.array([[0.0, 0.0, 80.0], [0.0, 10.0, 80.5], [0.0, 20.0, 81.0]]) + shift_m,
        enu_from_cam=np.tile(LEVEL, (3, 1)),
    )
    return still, flying


def solution() -> Solution:
    seen = Sightings(
        camera=("uav1", "uav2"),
        target=(VAN, BUS),
        frame=np.array([0, 3]),
        time_s=np.array([0.0, 1.62]),
        residual_px=np.array([[0.25, -0.5], [1e-7, 12.0]]),
        residual_sigma=np.array([0.559017, 12.0]),
        weight=np.array([1.0, 0.112]),
        position_enu_m=np.array([[0.0, 0.0, 1.0], [16.2, -16.9, 0.4225]]),
    )
    return Solution(
        method="map",
        status="converged",
        message="the cost no longer changes",
        iterations=7,
        cost=12.5,
        chi_square=25.0,
        degrees_of_freedom=20,
        clocks=(
            Clock(
                camera="uav1",
                offset_s=0.0,
                frame_rate=25.0,
                nominal_rate=25.0,
                offset_sigma_s=0.0,
                frame_rate_sigma=0.0,
            ),
            Clock(
                camera="uav2",
                offset_s=1.5,
                frame_rate=24.99,
                nominal_rate=25.0,
                offset_sigma_s=0.002,
                frame_rate_sigma=1e-4,
                deviation_frame=np.array([0.0, 12.5, 50.0]),
                deviation_s=np.array([0.0, 0.001, -0.002]),
                deviation_sigma_s=np.array([1e-4, 1e-4, np.nan]),
            ),
        ),
        poses=poses(0.25),
        motions=motions(),
        sightings=seen,
        biases=(
            Bias(
                camera="uav2",
                rotation_rad=np.radians([0.1, -0.2, 0.3]),
                rotation_sigma_rad=np.radians([0.01, 0.02, 0.03]),
                position_m=np.array([1.0, 2.0, 3.0]),
                position_sigma_m=np.array([0.1, 0.2, np.inf]),
            ),
        ),
        findings=(Finding(kind="time-gauge", subject="uav1", words="No clock is absolute.", carried_by="uav1"),),
        offset_candidates=(
            OffsetCandidate(offset_s={"uav2": 1.5}, cost=12.5),
            OffsetCandidate(offset_s={"uav2": 9.0}, cost=80.0, frame_rate={"uav2": 25.125}),
        ),
        shared_names=("uav2.offset_s", "uav2.frame_rate"),
        shared_covariance=np.array([[4e-6, 1e-7], [1e-7, 1e-8]]),
        shared_covariance_robust=np.array([[5e-6, 1e-7], [1e-7, 2e-8]]),
        motions_robust=(dataclasses.replace(motions()[0], covariance_band=2 * covariance_band(2, 1)),),
        seconds=123.456,
        settings={"robust": "huber", "search_s": np.float64(120.0)},
    )


def tiny_results(**changes: Any) -> Results:
    """Results of two cameras and two targets; `changes` replace fields."""
    told: dict[str, Any] = {
        "title": "Two cameras & <two> targets",
        "solution": solution(),
        "trajectories": tuple(sampled(m) for m in motions()),
        "tracks": tracks(),
        "measured_poses": poses(),
        "image_size": {"uav1": (1280, 720), "uav2": (1280, 720)},
        "origin": ORIGIN,
        "utc_s": UTC_S,
        "inputs": {"uav2.tlog": "b" * 64, "flight.toml": "a" * 64},
        "settings": {"method": "map", "rate_hz": 2.0, "cameras": ("uav1", "uav2"), "limit": float("nan")},
        "versions": {"runningfix": "0.1.0", "numpy": "2"},
        "warnings": ("One thing to know.",),
    }
    return Results(**(told | changes))
