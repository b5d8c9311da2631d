"""What is adjusted and what is known of it: the unknowns' order, their priors, one point in their space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.solver.adjustment.elimination import Loss, PoseError
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, FOCAL, Drift, common_time_s
from pipeline.solver.observation.known_motion import KnownMotion
from pipeline.solver.observation.motion_basis import MotionBasis, covered, jerk_rows
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.pose_wander import PoseWander
from pipeline.solver.observation.residuals import linearise, place_shift

CHUNK_FRAMES = 16384
"""Frames whose derivatives are held at once, where only the residuals are asked for."""
UP_SHARE = 0.03
"""Of the jerk prior's rows, up and down, for a target on the ground: it only has to bridge voids. Larger shares draw
targets to where the ground is more even, and nearer to a single camera, where a way over hills costs less."""
DRIFT_CENTRED_S = 1e-4
"""How exactly a deviation is held to have neither offset nor rate of its own: those are the affine clock's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """One point: `coefficients` (P, 3), `camera` (C, W), `deviation` (D,), frames' pose errors `own` (F, 6).

    wander (K, 6): pose errors at the knots of cameras whose poses wander
    ground (G,): what the ground is off by, metres; `KnownMotion.shared`
    """

    coefficients: Floats
    camera: Floats
    deviation: Floats
    own: Floats
    wander: Floats = field(default_factory=lambda: np.zeros((0, 6)))
    ground: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Priors:
    """What is known beforehand.

    camera_mean, camera_precision (C, W)  precision zero: nothing is known
    camera_free (C, W)  false: held
    jerk  (N, S) of splines in every span, m / s^2.5 (root of the power of white jerk); infinite: no prior
    drift_rate  (C,) of drifting clocks: how far the deviation walks, s / sqrt(s)
    """

    camera_mean: Floats
    camera_precision: Floats
    camera_free: Bools
    jerk: Floats
    drift_rate: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """Where every unknown sits in the vector: first the band (spline coefficients by time), then the border.

    coefficient (P, 3), camera (C, 11), drift (D,), wander (K, 6), ground (G,): places, -1 where held
    """

    coefficient: Ints
    camera: Ints
    drift: Ints
    n_band: int
    n_border: int
    width: int
    wander: Ints = field(default_factory=lambda: np.zeros((0, 6), dtype=np.int64))
    ground: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """An adjustment without the point it is at."""

    frames: Frames
    basis: MotionBasis
    drift: Drift
    pose: PoseError
    loss: Loss
    priors: Priors
    order: Order
    motion_free: bool = True
    drift_free: bool = True
    wander: PoseWander | None = None
    known: KnownMotion | None = None

    def changed(self, **values: object) -> Model:
        """The same with other parts; the order of the unknowns is made anew."""
        other = replace(self, **values)  # type: ignore[arg-type]
        order = order_unknowns(
            other.basis, other.drift, other.priors, motion_free=other.motion_free, drift_free=other.drift_free,
            wander=other.wander, errors=0 if other.known is None else other.known.count,
        )  # fmt: skip
        return replace(other, order=order)


def build_model(
    frames: Frames, basis: MotionBasis, drift: Drift, pose: PoseError, loss: Loss, priors: Priors,
    motion_free: bool = True, known: KnownMotion | None = None,
) -> Model:  # fmt: skip
    """A model with its unknowns in order."""
    return Model(
        frames=frames, basis=basis, drift=drift, pose=pose, loss=loss, priors=priors, motion_free=motion_free,
        order=order_unknowns(
            basis, drift, priors, motion_free=motion_free, drift_free=True, errors=0 if known is None else known.count
        ),
        known=known,
    )  # fmt: skip


NO_PLACES: Ints = np.empty(0, dtype=np.int64)


def order_unknowns(
    basis: MotionBasis, drift: Drift, priors: Priors, *, motion_free: bool, drift_free: bool,
    wander: PoseWander | None = None, errors: int = 0,
) -> Order:  # fmt: skip
    """Spline coefficients of all targets by their time in the band; everything else in the border."""
    coefficient = np.full((basis.count, 3), -1, dtype=np.int64)
    when, rows = [], []
    n_border = 0
    for t in basis.targets:
        if t.kind == "spline":
            rows.append(np.arange(t.first, t.first + t.count))
            windows = np.lib.stride_tricks.sliding_window_view(t.knots_s[1:], t.degree)
            when.append(windows[: t.count].mean(axis=1))
    band = np.concatenate(rows) if rows else NO_PLACES
    n_band = 3 * len(band) if motion_free else 0
    if motion_free:
        if rows:
            ranked = band[np.argsort(np.concatenate(when), kind="stable")]
            coefficient[ranked] = np.arange(n_band).reshape(-1, 3)
        for t in basis.targets:
            if t.kind == "polynomial":
                places = np.arange(n_band + n_border, n_band + n_border + 3 * t.count)
                coefficient[t.first : t.first + t.count] = places.reshape(3, t.count).T
                n_border += 3 * t.count
    camera = np.full(priors.camera_free.shape, -1, dtype=np.int64)
    free = int(priors.camera_free.sum())
    camera[priors.camera_free] = n_band + n_border + np.arange(free)
    n_border += free
    knots, drifts = drift.count if drift_free else 0, NO_PLACES
    if drift.count:
        drifts = np.full(drift.count, -1, dtype=np.int64)
        drifts[:knots] = n_band + n_border + np.arange(knots)
    n_border += knots
    wanders = np.full((0 if wander is None else wander.count, 6), -1, dtype=np.int64)
    if wander is not None:
        for c in range(len(priors.camera_free)):
            wanders[wander.of(c), wander.sigma[c] > 0] = 0
        n_free = int((wanders == 0).sum())
        wanders[wanders == 0] = n_band + n_border + np.arange(n_free)
        n_border += n_free
    ground = n_band + n_border + np.arange(errors) if motion_free else np.full(errors, -1)
    n_border += errors if motion_free else 0
    return Order(
        coefficient=coefficient, camera=camera, drift=drifts, wander=wanders, ground=ground, n_band=n_band,
        n_border=n_border, width=_band_width(basis, coefficient, n_band),
    )  # fmt: skip


def _band_width(basis: MotionBasis, coefficient: Ints, n_band: int) -> int:
    """How far apart two unknowns of the band can be that act in one span which the knots of both cover.

    What is seen beyond a target's knots, as clocks move, may reach further (`assembly.width_of`).
    """
    if not n_band:
        return 0
    low = np.full(len(basis.grid_s) - 1, n_band)
    high = np.zeros(len(basis.grid_s) - 1, dtype=np.int64)
    for t in basis.targets:
        if t.kind == "spline":
            own = np.flatnonzero(covered(basis, t))
            acting = coefficient[t.active[own][:, None] + np.arange(t.degree + 1)].reshape(len(own), -1)
            low[own], high[own] = np.minimum(low[own], acting.min(axis=1)), np.maximum(high[own], acting.max(axis=1))
    return int((high - low).max())


def jerk_penalty(model: Model, target: int) -> tuple[Ints, Floats, Ints]:
    """A spline's prior: first acting coefficient (p,), rows (p, 4, 3) by axis whose squares sum to twice its cost.

    Up and down a target on the ground goes as the ground does.
    """
    first, rows, span = jerk_rows(model.basis, model.basis.targets[target])
    axes = np.array([1.0, 1.0, UP_SHARE if is_on_ground(model, target) else 1.0])
    return first, (rows / model.priors.jerk[target, span][:, None])[..., None] * axes, span


def is_on_ground(model: Model, target: int) -> bool:
    """Whether the ground holds a target."""
    return model.known is not None and bool((model.known.axis[model.known.target == target] < 0).any())


def drift_penalty(drift: Drift, camera: int, rate: float) -> Floats:
    """(k, k) of one clock's knots: a random walk, without offset and rate of its own."""
    knots = drift.knot_s[drift.of(camera)]
    k = len(knots)
    step = np.diff(np.eye(k), axis=0) / (rate * np.sqrt(np.diff(knots)))[:, None]
    middle = (knots - knots.mean()) / max(float(np.ptp(knots)), 1e-9)
    level = np.stack([np.full(k, 1 / k), middle / max(float(np.abs(middle).sum()), 1e-9)]) / DRIFT_CENTRED_S
    return np.asarray(step.T @ step + level.T @ level)


def pose_error(model: Model, state: State, rows: slice | Ints) -> Floats:
    """(n, 6) what the measured poses of the frames `rows` are wrong by: constant, wandering, their own."""
    camera = model.frames.camera[rows]
    error = state.camera[camera, :6] + model.pose.spread[camera] * state.own[rows]
    return error if model.wander is None else error + model.wander.at(state.wander, rows)


def wander_square(model: Model, state: State) -> float:
    """Squared prior residuals of wandering poses."""
    if model.wander is None:
        return 0.0
    total = 0.0
    for c, axis, matrix in model.wander.penalties:
        value = state.wander[model.wander.of(c), axis]
        total += float(value @ matrix @ value)
    return total


def residuals_of(frames: Frames, part: slice, model: Model, state: State) -> Floats:
    """(n, N, 2): residuals of the frames `part` at a point, as `frames` measures them; place errors are in pixels."""
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    begin, end, _ = part.indices(frames.count)
    out = np.empty((end - begin, len(frames.targets), 2))
    for low in range(begin, end, CHUNK_FRAMES):
        own = slice(low, min(low + CHUNK_FRAMES, end))
        out[low - begin : own.stop - begin] = _residuals(frames, own, model, state, time[own])
    return out


def _residuals(frames: Frames, part: slice, model: Model, state: State, time_s: Floats) -> Floats:
    camera = frames.camera[part]
    error = pose_error(model, state, part)
    position = model.basis.position(time_s, state.coefficients)
    found = linearise(frames, part, position, error, state.camera[camera, FOCAL]).residual
    if state.camera.shape[1] > CAMERA_PARAMETERS and frames.angular:
        found = found + place_shift(frames, part, state.camera)
    return found
