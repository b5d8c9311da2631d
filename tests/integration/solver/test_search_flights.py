"""The search on whole flights: several cameras, free motion, and the real flights where they are at hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.flight import read_flight
from pipeline.geometry import rotation
from pipeline.records import (
    CameraInput,
    InstrumentSigma,
    OffsetCandidate,
    PoseTrack,
    Problem,
    SightRays,
    SolverSettings,
    TargetInput,
)
from pipeline.solver.offset_search.search import is_ambiguous, search_offsets
from pipeline.stages.inputs.cameras import read_models
from pipeline.stages.inputs.sources import open_sources
from pipeline.stages.inputs.tracks import detections
from pipeline.stages.poses.measure import measure_poses
from pipeline.stages.problem.build import build_problem

REAL = Path(__file__).parents[4] / "shared/real/multicam"
SIGMA = InstrumentSigma(
    attitude_bias_rad=float(np.radians(1.5)),
    attitude_rad=0.0,
    position_bias_m=0.1,
    position_m=0.0,
    pixel_px=2.0,
    frame_rate=0.01,
)
PLACES = np.array([[-40.0, 10.0, 2.0], [35.0, -20.0, 3.0], [10.0, 50.0, 1.0]])
OFFSETS = (0.0, 41.7, -73.2)
RATES = (30.0, 24.0, 50.0)


def drone(target: int, time_s: Floats) -> Floats:
    """A free flight, never straight, other for each target."""
    t = time_s + 50.0 * target
    east = 12 * np.sin(0.31 * t) + 6 * np.sin(0.83 * t + 1)
    north = 10 * np.cos(0.27 * t) + 5 * np.sin(0.71 * t + 2)
    return np.stack([east, north, 20 + 5 * np.sin(0.41 * t) + 2 * np.sin(1.3 * t)], axis=1)


def tripod(number: int, targets: tuple[str, ...]) -> CameraInput:
    """Thirty seconds and more of one camera that stands still, 4 % off in rate, a fifth of its labels wrong."""
    rng = np.random.default_rng(number)
    begin, end = (-20.0, -25.0, -15.0)[number], (20.0, 15.0, 25.0)[number]
    first = max(int((begin + 80.0 - OFFSETS[number]) * RATES[number]), 0)
    count = int((end - begin) * RATES[number])
    frame = first + np.arange(0, count, 3)
    true = frame / RATES[number] + OFFSETS[number] - 80.0
    told_hz = RATES[number] * (1.0, 1.04, 0.96)[number]
    look = -PLACES[number] + [0, 0, 20.0]
    attitude = rotation.enu_from_cam(
        rotation.ned_from_frd(
            np.arctan2(look[0], look[1]), np.arctan2(look[2], np.hypot(look[0], look[1])), np.array(0.0)
        )
    )
    m, k = len(frame), len(targets)
    points = np.stack([drone(int(t[1:]), true) for t in targets], axis=1) - PLACES[number]
    seen = rotation.rotate(rotation.conjugate(attitude), points)
    flat = seen[..., :2] / seen[..., 2:] + rng.normal(0, 2e-3, (m, k, 2))
    flat += (rng.random((m, k, 1)) < 0.1) * rng.normal(0, 0.2, (m, k, 2))
    ray = np.concatenate([flat, np.ones((m, k, 1))], axis=2).reshape(-1, 3)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    x, y, z = ray.T
    zero = 0 * x
    jacobian = 1000 * np.stack([np.stack([1 / z, zero, -x / z**2], 1), np.stack([zero, 1 / z, -y / z**2], 1)], axis=1)
    turned = rotation.multiply(attitude, rotation.exp(rng.normal(0, SIGMA.attitude_bias_rad, 3)))
    return CameraInput(
        camera=f"cam{number}",
        rays=SightRays(
            camera=f"cam{number}",
            targets=targets,
            target=np.tile(np.arange(k), m),
            frame=np.repeat(frame, k),
            time_s=np.repeat(frame, k) / told_hz,
            direction_cam=ray,
            pixel_from_ray=jacobian,
            sigma_px=np.full(m * k, SIGMA.pixel_px),
        ),
        poses=PoseTrack(
            camera=f"cam{number}",
            frame=frame,
            time_s=frame / told_hz,
            position_enu_m=np.tile(PLACES[number], (m, 1)),
            enu_from_cam=np.tile(turned, (m, 1)),
        ),
        frame_rate=told_hz,
        sigma=SIGMA,
        still=True,
    )


def middle_errors_s(problem: Problem, candidate: OffsetCandidate) -> dict[str, float]:
    """Errors of the common time at mid-track."""
    out = {}
    for number, camera in enumerate(problem.cameras):
        frame = float(np.median(camera.rays.frame))
        found = frame / candidate.frame_rate[camera.camera] + candidate.offset_s[camera.camera]
        out[camera.camera] = found - (frame / RATES[number] + OFFSETS[number])
    return out


def free_flight(sees: tuple[tuple[str, ...], ...]) -> Problem:
    names = sorted({t for own in sees for t in own})
    return Problem(
        cameras=tuple(tripod(i, own) for i, own in enumerate(sees)),
        targets=tuple(TargetInput(target=t, motion="spline") for t in names),
        reference_camera="cam0",
    )


@pytest.mark.parametrize(
    "sees", [(("t0",),) * 3, (("t0",), ("t0", "t1"), ("t1",))], ids=["one target", "linked by the second camera"]
)
def test_free_motion_of_three_unsynchronised_tripods(sees: tuple[tuple[str, ...], ...]) -> None:
    problem = free_flight(sees)
    found = search_offsets(problem, SolverSettings())
    assert max(abs(e) for e in middle_errors_s(problem, found[0]).values()) < 0.05
    assert not is_ambiguous(found)
    assert len(found) > 1


def test_progress_is_told() -> None:
    told: list[float] = []
    search_offsets(free_flight((("t0",),) * 3), SolverSettings(), progress=told.append)
    assert told == [0.5, 1.0]


def test_a_search_too_narrow_is_refused_in_words() -> None:
    problem = free_flight((("t0",), ("t0",), ("t0",)))
    with pytest.raises(GeometryError, match="search further"):
        search_offsets(problem, replace(SolverSettings(), search_s=0.5))


def real_problem(name: str) -> Problem:
    if not REAL.is_dir():
        pytest.skip(f"{name} is not beside the project (../shared/real/multicam)")
    flight = read_flight(REAL / name / "flight.toml")
    tracks = tuple(t for c in flight.cameras for t in detections(flight, c))
    measured = measure_poses(flight, open_sources(flight), tracks)
    return build_problem(flight, tracks, measured, read_models(flight)).problem


@pytest.mark.real
@pytest.mark.parametrize("name", ["flight1", "flight3"])
def test_the_real_flights(name: str) -> None:
    problem = real_problem(name)
    found = search_offsets(problem, SolverSettings())
    truth = json.loads((REAL / name / "truth/reference.json").read_text())["cameras"]
    reference = truth["cam0"]
    scale = reference["fps"] / problem.cameras[0].frame_rate
    for camera in problem.cameras:
        clock = truth[camera.camera]
        frame = float(np.median(camera.rays.frame))
        true_s = (clock["offset_s"] + frame / clock["fps"] - reference["offset_s"]) * scale
        mine_s = frame / found[0].frame_rate[camera.camera] + found[0].offset_s[camera.camera]
        assert abs(mine_s - true_s) < 0.05, camera.camera
    assert not is_ambiguous(found)
