"""Small problems with every feature of the solver, for its tests."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.records import PoseTrack, Problem, SightRays, SolverSettings, TargetInput
from pipeline.records.motion import MotionKind
from pipeline.solver.adjustment.elimination import CAUCHY, HUBER, Loss
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.parameters import MotionChoice, basis_at, first_camera, first_model
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, READOUT, START, common_time_s, drift_knots
from pipeline.solver.observation.observations import pack
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

T = TypeVar("T")
LOSSES = {"none": Loss(), "huber": Loss(kind=HUBER, bend=1.5), "cauchy": Loss(kind=CAUCHY, bend=1.5)}


def rich_model(
    kinds: tuple[MotionKind, ...] = ("polynomial", "spline"), loss: str = "none", drift: bool = True,
    pose_rate: bool = True, method: str = "map", seed: int = 1, rolled: bool = False,
) -> tuple[Model, State]:  # fmt: skip
    """Two cameras, hidden frames, lenses that distort, every parameter free, a state away from the optimum."""
    rng = np.random.default_rng(seed)
    problem, _ = simulate(paper_scene(order=2, targets=len(kinds)), noise=PAPER_LOW, seed=seed)
    frames = pack(problem)
    hidden = rng.random(frames.seen.shape) < 0.1
    rate = rng.normal(size=(frames.count, 6)) * [0.05, 0.05, 0.05, 5, 5, 5] if pose_rate else None
    effect = np.array([1.2, 0.4]) + 0.2 * np.random.default_rng(seed).normal(size=(*hidden.shape, 2))
    frames = changed(
        frames, seen=frames.seen & ~hidden, gain=np.where(hidden[..., None, None], 0.0, frames.gain), pose_rate=rate,
        focal_effect=effect,
    )  # fmt: skip
    camera = first_camera(problem, {"uav2": 0.45}, {"uav2": 10.1})
    choice = MotionChoice(kinds=kinds, orders=tuple(range(2, 2 + len(kinds))), spacing_s=0.8)
    if rolled:
        by_readout = 50 * np.random.default_rng(seed).normal(size=(*hidden.shape, 2))
        frames = changed(frames, by_readout=by_readout * frames.seen[..., None])
    settings = SolverSettings(method=method)
    model, state = first_model(problem, settings, frames, choice, camera)
    drifting = drift_knots(frames, {1: 1.5}) if drift else model.drift
    free = model.priors.camera_free.copy()
    free[:, 6] = True
    free[:, START] = pose_rate
    free[:, READOUT] = rolled
    priors = changed(model.priors, camera_free=free, drift_rate=np.full(2, 0.05))
    model = model.changed(frames=frames, drift=drifting, priors=priors, loss=LOSSES[loss])
    basis = basis_at(frames, choice, common_time_s(frames, drifting, camera, np.zeros(drifting.count)))
    model = model.changed(basis=basis)
    jitter = np.array([0.01] * 3 + [1.0] * 3 + [0.01, 0.05, 0.003, 0.02])
    camera[:, :READOUT] += np.where(free[:, :READOUT], rng.normal(size=(2, 10)) * jitter, 0.0)
    state = State(
        coefficients=rng.normal(size=(basis.count, 3)) * 20,
        camera=camera,
        deviation=rng.normal(size=drifting.count) * 0.02,
        own=rng.normal(size=(frames.count, 6)),
    )
    return model, state


def placed_model(kinds: tuple[MotionKind, ...], loss: str = "none", seed: int = 2) -> tuple[Model, State]:
    """Affine clocks, held log time, hidden frames, and targets tracked at other points by each camera."""
    rng = np.random.default_rng(seed)
    problem, _ = simulate(paper_scene(order=2, targets=len(kinds)), noise=PAPER_LOW, seed=seed)
    rays = [replace(c.rays, place_sigma_px=(2.0, 1.0)) for c in problem.cameras]
    problem = replace(problem, cameras=tuple(replace(c, rays=r) for c, r in zip(problem.cameras, rays, strict=True)))
    frames = pack(problem)
    shown = rng.random(frames.seen.shape) > 0.1
    frames = changed(
        frames, seen=frames.seen & shown, gain=np.where(shown[..., None, None], frames.gain, 0.0),
        place_gain=np.where(shown, frames.place_gain, 0.0),
    )  # fmt: skip
    camera = first_camera(problem, {"uav2": 0.45}, {"uav2": 10.1})
    choice = MotionChoice(kinds=kinds, orders=tuple(range(2, 2 + len(kinds))), spacing_s=0.8)
    model, state = first_model(problem, SolverSettings(), frames, choice, camera)
    camera[:, CAMERA_PARAMETERS:] = rng.normal(size=camera[:, CAMERA_PARAMETERS:].shape)
    coefficients = rng.normal(size=state.coefficients.shape) * 20
    own = rng.normal(size=(frames.count, 6))
    return changed(model, loss=LOSSES[loss]), changed(state, camera=camera, coefficients=coefficients, own=own)


def looped_flight(
    wobble_s: float, seed: int = 0, seconds: float = 150.0, wide: float = 1.0
) -> tuple[Problem, CubicSpline]:
    """Three still cameras around a target on a looping path; the third camera's clock wobbles."""
    rng = np.random.default_rng(seed)
    knots = np.arange(-20.0, seconds + 20.0, 4.0)
    path = CubicSpline(knots, rng.normal(size=(len(knots), 3)) * [12.0 * wide, 12.0 * wide, 4.0] + [0.0, 0.0, 25.0])
    cameras = []
    for c, (east, north) in enumerate([(-60.0, -50.0), (70.0, -40.0), (0.0, 80.0)]):
        place = np.array([east, north, 2.0])
        frame = np.arange(int(10 * seconds))
        time = frame / 10.0 + 0.05 * c
        if c == 2:
            time = time + wobble_s * np.sin(2 * np.pi * time / 75.0)
        ahead = np.array([-east, -north, 20.0]) / np.linalg.norm([east, north, 20.0])
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        cam_from_enu = np.stack([right, np.cross(ahead, right), ahead])
        y = (path(time) - place) @ cam_from_enu.T
        flat = y[:, :2] / y[:, 2:] + 1e-3 * rng.normal(size=(len(y), 2))
        direction = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
        length = np.linalg.norm(direction, axis=1)
        slope = np.zeros((len(flat), 2, 3))
        slope[:, 0, 0] = slope[:, 1, 1] = 1000 * length
        slope[:, :, 2] = -1000 * length[:, None] * flat
        name = f"cam{c}"
        rays = SightRays(
            camera=name, targets=("drone",), target=np.zeros(len(frame), int), frame=frame, time_s=frame / 10.0,
            direction_cam=direction / length[:, None], pixel_from_ray=slope, sigma_px=np.ones(len(frame)),
        )  # fmt: skip
        turn = rotation.conjugate(rotation.from_matrix(cam_from_enu))
        poses = PoseTrack(
            camera=name, frame=frame, time_s=frame / 10.0, position_enu_m=np.tile(place, (len(frame), 1)),
            enu_from_cam=np.tile(turn, (len(frame), 1)),
        )  # fmt: skip
        template = simulate(paper_scene(), noise=PAPER_LOW, seed=0)[0].cameras[0]
        sigma = replace(
            template.sigma,
            attitude_rad=0.0,
            position_m=0.0,
            attitude_bias_rad=1e-3,
            position_bias_m=0.05,
            frame_rate=0.05,
        )
        cameras.append(
            replace(template, camera=name, rays=rays, poses=poses, sigma=sigma, clock="auto", still=True, offset_s=0.0)
        )
    problem = Problem(
        cameras=tuple(cameras), targets=(TargetInput(target="drone", motion="spline"),), reference_camera="cam0"
    )
    return problem, path


def changed(record: T, **values: object) -> T:
    """A record with other values."""

    return replace(record, **values)  # type: ignore[type-var]


def with_unknowns(model: Model, state: State, step: Floats, own: Floats) -> State:
    """The state moved by a step of the unknowns in their order, and of the frames' own errors."""
    order = model.order

    def part(place: Floats) -> Floats:
        return np.where(place >= 0, step[place], 0.0)

    return State(
        coefficients=state.coefficients + part(order.coefficient),
        camera=state.camera + part(order.camera),
        deviation=state.deviation + part(order.drift),
        own=state.own + own,
    )
