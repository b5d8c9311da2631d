"""The way to the compiled descent, for models whose unknowns all sit in the border: see `_descent.py`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from calibration.arrays import Floats, Ints
from pipeline.solver import _descent, _kernels
from pipeline.solver.blocks import shortened
from pipeline.solver.elimination import Loss, PoseError
from pipeline.solver.layout import Frames
from pipeline.solver.model import Model, State
from pipeline.solver.timing import CAMERA_PARAMETERS

MOST_SIGHTINGS = 200_000
"""Beyond, a pass takes long enough that Python between the passes costs nothing, and a person wants to see progress."""
STATUS = {_descent.CONVERGED: "converged", _descent.LIMIT: "iteration-limit", _descent.STALLED: "stalled"}


def is_dense(model: Model) -> bool:
    """Whether the compiled descent knows the model: one span, no drift, poses held in log time, no place errors."""
    known = model.priors.camera_mean.shape[1] == CAMERA_PARAMETERS and model.frames.pose_rate is None
    one_span = len(model.basis.grid_s) == 2 and model.order.n_band == 0 and model.drift.count == 0
    return bool(_kernels.AVAILABLE and known and one_span and model.frames.seen.size <= MOST_SIGHTINGS)


def _shape(model: Model) -> tuple[Any, ...]:
    """Times, blocks and basis as the compiled code wants them."""
    frames, basis = model.frames, model.basis
    begin = shortened(frames.first)
    first: Ints = np.array([t.first for t in basis.targets], dtype=np.int64)
    low, high = float(basis.grid_s[0]), float(basis.grid_s[1])
    return (
        frames.video_s, frames.camera, begin, frames.camera[begin[:-1]], 0.5 * (low + high), 0.5 * (high - low),
        basis.transforms[0], first, basis.degrees, model.order.coefficient,
    )  # fmt: skip


NO_RATE = np.zeros((1, 6))


def descend(model: Model, start: State, limit: int, small: float, first_damping: float) -> tuple[Any, ...]:
    """(status, iterations, state, corner, gradient, cost, frame gain, cost after each iteration)."""
    frames, pose, loss, order = model.frames, model.pose, model.loss, model.order
    history = np.zeros(limit)
    start_at = (start.camera, start.coefficients, start.own)
    status, iterations, camera, coefficients, own, corner, right, cost, gain = _call(
        model, frames.gain, frames.angular, pose, loss, order.camera, order.n_border,
        model.priors.camera_precision, start_at, limit, small, first_damping, history, 0.0,
    )  # fmt: skip
    state = State(coefficients=coefficients, camera=camera, deviation=start.deviation, own=own)
    return STATUS[status], iterations, state, corner, right, cost, gain, history[:iterations]


def motion_step(model: Model, state: State, frames: Frames, rank: float) -> tuple[Floats, float]:
    """The motion (P, 3) one linear step on, with the linear residuals of `frames`; and the smallest pivot.

    `model` has all coefficients free. Pivot -1: a coefficient touches no sight ray; 0: singular.
    """
    across: Callable[..., Floats] = _descent.across
    gain = frames.gain if not frames.angular else across(frames.ray, frames.seen)
    held = PoseError(spread=np.zeros((len(state.camera), 6)), prior=np.zeros((len(state.camera), 6)))
    found = _call(
        model, gain, False, held, Loss(), np.full(state.camera.shape, -1), 3 * len(state.coefficients),
        np.zeros(state.camera.shape), (state.camera, state.coefficients, np.zeros((frames.count, 6))),
        1, 0.0, 0.0, np.zeros(1), rank,
    )  # fmt: skip
    return found[3], float(found[7])


def median_length(model: Model, state: State) -> float:
    """Median length of the sightings' residuals, in sigmas."""
    frames, shape = model.frames, _shape(model)
    compiled: Callable[..., float] = _descent.median_length
    return compiled(
        frames.cam_from_enu, frames.position_m, frames.ray, frames.gain, frames.seen, frames.angular,
        model.pose.spread, frames.video_s, frames.camera, *shape[4:9], state.camera, state.coefficients, state.own,
    )  # fmt: skip


def _call(
    model: Model, gain: Floats, angular: bool, pose: PoseError, loss: Loss, order_camera: Ints, size: int,
    precision: Floats, start: tuple[Floats, Floats, Floats], limit: int, small: float, first_damping: float,
    history: Floats, rank: float,
) -> tuple[Any, ...]:  # fmt: skip
    """The compiled function, its arguments in their order and of their types."""
    frames = model.frames
    compiled: Callable[..., tuple[Any, ...]] = _descent.descend
    return compiled(
        frames.cam_from_enu, frames.position_m, NO_RATE, frames.ray, gain, frames.seen, False, angular, pose.spread,
        pose.prior, float(pose.damping), loss.kind, float(loss.bend), *_shape(model), order_camera, size,
        model.priors.camera_mean, precision, *start, limit, float(small), float(first_damping), history, float(rank),
    )  # fmt: skip


def warm() -> None:
    """Compiles, or loads from the cache, the descent: the clock of a solve shall not count it."""
    if not _kernels.AVAILABLE or warm.done:  # type: ignore[attr-defined]
        return
    _kernels.warm()
    i, f, eye = np.zeros(1, np.int64), np.zeros, np.eye(3)[None]
    begin, seen = np.array([0, 1]), np.ones((1, 1), dtype=bool)
    ray, gain = np.array([[[0.0, 0.0, 1.0]]]), np.zeros((1, 1, 2, 3))
    shape = (f(1), i, begin, i, 0.0, 1.0, np.ones((1, 1, 1)), i, i, np.arange(3)[None])
    poses = (eye, f((1, 3)), NO_RATE, ray, gain, seen)
    calls: tuple[Callable[..., Any], ...] = (_descent.across, _descent.descend, _descent.median_length)
    calls[0](ray, seen)
    calls[1](
        *poses, False, True, f((1, 6)), np.ones((1, 6)), 0.0, 0, 1.0, *shape, np.full((1, 10), -1), 3, f((1, 10)),
        f((1, 10)), f((1, 10)), f((1, 3)), f((1, 6)), 1, 1e-9, 1e-4, f(1), 0.0,
    )  # fmt: skip
    calls[2](
        eye, f((1, 3)), ray, gain, seen, True, f((1, 6)), f(1), i, 0.0, 1.0, np.ones((1, 1, 1)), i, i, f((1, 10)),
        f((1, 3)), f((1, 6)),
    )  # fmt: skip
    warm.done = True  # type: ignore[attr-defined]


warm.done = False  # type: ignore[attr-defined]
