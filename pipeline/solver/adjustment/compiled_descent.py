"""The way to the compiled descent, for models whose unknowns all sit in the border: see `_descent.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.solver.adjustment import _descent, _kernels
from pipeline.solver.adjustment.elimination import kept_room
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS
from pipeline.solver.observation.frame_blocks import share_per_second, shortened
from pipeline.solver.observation.observations import Frames

MOST_SIGHTINGS = 2_000_000
"""A pass over so many takes half a second; beyond, Python between the passes costs nothing and shows progress."""


@dataclass(frozen=True, kw_only=True)
class Stages:
    """Of a graduated loss: how many, iterations of each at most, what ends one, median residuals at which it bends."""

    count: int
    short: int
    coarse: float
    far: float


COMPILED: Callable[..., tuple[Any, ...]] = _descent.graduated
"""The one way in, so that all of it is compiled once."""
ANY = 1 << 62
STATUS = {_descent.CONVERGED: "converged", _descent.LIMIT: "iteration-limit", _descent.STALLED: "stalled"}


def is_dense(model: Model) -> bool:
    """Whether the compiled descent knows the model: one span, no drift, poses held in log time."""
    one_span = len(model.basis.grid_s) == 2 and model.order.n_band == 0 and model.drift.count == 0
    one_span = one_span and (model.wander is None or model.wander.count == 0)
    held = model.frames.pose_rate is None and model.frames.seen.size <= MOST_SIGHTINGS
    return bool(_kernels.AVAILABLE and one_span and held)


def _scene(model: Model) -> tuple[Any, ...]:
    """What is seen, when and how well, as the compiled code wants it."""
    frames, pose, loss = model.frames, model.pose, model.loss
    placed = _is_placed(model)
    per_s = share_per_second(frames) if placed else np.zeros(len(frames.cameras))
    begin, low, high = shortened(frames.first), float(model.basis.grid_s[0]), float(model.basis.grid_s[1])
    return (
        frames.cam_from_enu, frames.position_m, NO_RATE, frames.ray, frames.gain, frames.focal_effect, frames.seen,
        False, frames.angular, pose.spread, pose.prior, float(pose.damping), loss.kind, float(loss.bend),
        frames.video_s, frames.camera, frames.place_gain if placed else frames.place_gain[:0], frames.place_share,
        per_s, begin, frames.camera[begin[:-1]], 0.5 * (low + high), 0.5 * (high - low),
    )  # fmt: skip


def _is_placed(model: Model) -> bool:
    """Whether tracked points may sit elsewhere on their targets."""
    return model.frames.angular and model.priors.camera_mean.shape[1] > CAMERA_PARAMETERS


NO_RATE = np.zeros((1, 6))
ONE_STAGE = Stages(count=0, short=1, coarse=1.0, far=1.0)


def descend(model: Model, start: State, limit: int, small: float, first_damping: float) -> tuple[Any, ...]:
    """(status, iterations, state, corner, gradient, cost, frame gain, cost after each iteration)."""
    return graduated(model, start, limit, small, first_damping, ONE_STAGE)


def graduated(
    model: Model, start: State, limit: int, small: float, first_damping: float, stages: Stages
) -> tuple[Any, ...]:
    """The same, through stages in which the loss bends late: see `beginning.graduated`."""
    frames = model.frames
    history = np.zeros(limit + stages.count * stages.short)
    given = (*_from(model, start), limit, float(small), float(first_damping), history)
    kept = kept_room(frames, shortened(frames.first), _is_placed(model), ANY if model.pose.free else 0)
    status, iterations, camera, coefficients, own, corner, right, cost, gain = COMPILED(
        *given, stages.count, stages.short, float(stages.coarse), float(stages.far), kept
    )
    state = State(coefficients=coefficients, camera=camera, deviation=start.deviation, own=own, wander=start.wander)
    return STATUS[status], iterations, state, corner, right, cost, gain, history[:iterations]


def _from(model: Model, start: State) -> tuple[Any, ...]:
    order, basis = model.order, model.basis
    return (
        *_scene(model), basis.firsts, basis.degrees, basis.degree + 1, order.coefficient, order.camera,
        order.n_border, model.priors.camera_mean, model.priors.camera_precision, start.camera, start.coefficients,
        start.own,
    )  # fmt: skip


def motion_step(model: Model, state: State, frames: Frames, rank: float) -> tuple[Floats, float]:
    """The motion (P, 3) one linear step on, with the linear residuals of `frames`; and the smallest pivot.

    `model` has all coefficients free. Pivot -1: a coefficient touches no sight ray; 0: singular.
    """
    compiled: Callable[..., float] = _descent.motion_alone
    basis, out = model.basis, np.zeros(state.coefficients.shape)
    pivot = compiled(
        frames.cam_from_enu, frames.position_m, frames.ray, frames.gain, frames.seen, frames.angular, frames.video_s,
        frames.camera, float(basis.mid_s[0]), float(basis.half_s[0]), basis.firsts, basis.degrees, state.camera, rank,
        out,
    )  # fmt: skip
    return out, pivot


def warm() -> None:
    """Compiles, or loads from the cache, the descent: the clock of a solve shall not count it."""
    if not _kernels.AVAILABLE or warm.done:  # type: ignore[attr-defined]
        return
    _kernels.warm()
    i, f, eye = np.zeros(1, np.int64), np.zeros, np.eye(3)[None]
    begin, seen = np.array([0, 1]), np.ones((1, 1), dtype=bool)
    ray, gain = np.array([[[0.0, 0.0, 1.0]]]), np.zeros((1, 1, 2, 3))
    alone: Callable[..., Any] = _descent.motion_alone
    scene = (
        eye, f((1, 3)), NO_RATE, ray, gain, f((0, 1, 2)), seen, False, True, f((1, 6)), np.ones((1, 6)), 0.0, 0, 1.0,
        f(1), i, f((0, 1)), f(1), f(1), begin, i, 0.0, 1.0,
    )  # fmt: skip
    unknowns = (i, i, 1, np.arange(3)[None], np.full((1, 10), -1), 3, f((1, 10)), f((1, 10)))
    start = (f((1, 10)), f((1, 3)), f((1, 6)), 1, 1e-9, 1e-4)
    alone(eye, f((1, 3)), ray, gain, seen, True, f(1), i, 0.0, 1.0, i, i, f((1, 10)), 1e-12, f((1, 3)))
    kept = f(_kernels.kept_shape(begin, 1, False, False))
    COMPILED(*scene, *unknowns, *start, f(3), 1, 1, 1e-2, 2.5, kept)
    warm.done = True  # type: ignore[attr-defined]


warm.done = False  # type: ignore[attr-defined]
