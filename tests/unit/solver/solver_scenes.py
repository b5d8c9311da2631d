"""Small problems with every feature of the solver, for its tests."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from calibration.arrays import Floats
from pipeline.records import SolverSettings
from pipeline.records.motion import MotionKind
from pipeline.solver.elimination import CAUCHY, HUBER, Loss
from pipeline.solver.layout import pack
from pipeline.solver.model import Model, State
from pipeline.solver.start import MotionChoice, basis_at, first_camera, first_model
from pipeline.solver.timing import common_time_s, drift_knots
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate

T = TypeVar("T")
LOSSES = {"none": Loss(), "huber": Loss(kind=HUBER, bend=1.5), "cauchy": Loss(kind=CAUCHY, bend=1.5)}


def rich_model(
    kinds: tuple[MotionKind, ...] = ("polynomial", "spline"), loss: str = "none", drift: bool = True,
    pose_rate: bool = True, method: str = "map", seed: int = 1,
) -> tuple[Model, State]:  # fmt: skip
    """Two cameras, hidden frames, every parameter free, a state away from the optimum."""
    rng = np.random.default_rng(seed)
    problem, _ = simulate(paper_scene(order=2, targets=len(kinds)), noise=PAPER_LOW, seed=seed)
    frames = pack(problem)
    hidden = rng.random(frames.seen.shape) < 0.1
    rate = rng.normal(size=(frames.count, 6)) * [0.05, 0.05, 0.05, 5, 5, 5] if pose_rate else None
    frames = changed(
        frames, seen=frames.seen & ~hidden, gain=np.where(hidden[..., None, None], 0.0, frames.gain), pose_rate=rate
    )
    camera = first_camera(problem, {"uav2": 0.45}, {"uav2": 10.1})
    choice = MotionChoice(kinds=kinds, orders=tuple(range(2, 2 + len(kinds))), spacing_s=0.8)
    settings = SolverSettings(method=method)
    model, state = first_model(problem, settings, frames, choice, camera)
    drifting = drift_knots(frames, {1: 1.5}) if drift else model.drift
    free = model.priors.camera_free.copy()
    free[:, 6] = True
    free[:, 9] = pose_rate
    priors = changed(model.priors, camera_free=free, drift_rate=np.full(2, 0.05))
    model = model.changed(frames=frames, drift=drifting, priors=priors, loss=LOSSES[loss])
    basis = basis_at(frames, choice, common_time_s(frames, drifting, camera, np.zeros(drifting.count)))
    model = model.changed(basis=basis)
    jitter = np.array([0.01] * 3 + [1.0] * 3 + [0.01, 0.05, 0.003, 0.02])
    camera = camera + np.where(free, rng.normal(size=(2, 10)) * jitter, 0.0)
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
    camera[:, 10:] = rng.normal(size=camera[:, 10:].shape)
    coefficients = rng.normal(size=state.coefficients.shape) * 20
    own = rng.normal(size=(frames.count, 6))
    return changed(model, loss=LOSSES[loss]), changed(state, camera=camera, coefficients=coefficients, own=own)


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
