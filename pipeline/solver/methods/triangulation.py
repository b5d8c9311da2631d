"""Triangulation of synchronised frames (paper eq. 6), the classical method that the asynchronous ones replace.

Every frame of the reference camera is paired with the frame of each other camera that is nearest in common time (at
the given offsets, zero where none is given), at most half a frame interval away; what moves between the two is
ignored. Each target seen from two or more of them gives a point, sum V X = sum V C. A motion is then fitted to the
points by least squares: the polynomial of the target's order, or its spline with the solver's first prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import GeometryError
from pipeline.records import Problem, SolverSettings
from pipeline.solver.adjustment.model import Model, State, jerk_penalty
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model, given_offsets
from pipeline.solver.methods.results import Outcome
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import Frames, metric

FLATTEST = 1e-6
"""Smallest over largest eigenvalue of sum V: rays that are nearer to parallel give no point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseCovariance:
    """A covariance held whole: `matrix` (n, n)."""

    matrix: Floats

    def pairs(self, i: Ints, j: Ints) -> Floats:
        """See `Covariance`."""
        return np.asarray(self.matrix[i, j])


def triangulate(problem: Problem, settings: SolverSettings, frames: Frames) -> Outcome:
    """Points of synchronised frames and a motion through them."""
    camera = first_camera(problem, given_offsets(problem), {})
    model, state = first_model(problem, settings, metric(frames), first_choice(problem, settings.method), camera)
    time = common_time_s(frames, model.drift, camera, np.empty(0))
    partners = synchronised(problem, frames, time)
    coefficients = state.coefficients.copy()
    size = model.order.n_band + model.order.n_border
    covariance = np.zeros((size, size))
    cost = 0.0
    for n, t in enumerate(model.basis.targets):
        at, points = points_of(model.frames, partners, time, n)
        own, spread, own_cost = _through(model, n, at, points)
        coefficients[t.first : t.first + t.count] = own
        for axis in range(3):
            place = model.order.coefficient[t.first : t.first + t.count, axis]
            covariance[np.ix_(place, place)] = spread
        cost += own_cost
    state = State(coefficients=coefficients, camera=camera, deviation=state.deviation, own=state.own)
    return Outcome(
        model=model, observed=frames, state=state, status="converged", iterations=1, cost=cost,
        plain=DenseCovariance(matrix=covariance),
    )  # fmt: skip


def synchronised(problem: Problem, frames: Frames, time_s: Floats) -> Ints:
    """(R, C): for every frame of the reference camera, the frame of each camera at that time, -1 where none is."""
    reference = frames.cameras.index(problem.reference_camera)
    mine = np.arange(frames.of(reference).start, frames.of(reference).stop)
    out = np.full((len(mine), len(frames.cameras)), -1, dtype=np.int64)
    for c, camera in enumerate(problem.cameras):
        part = frames.of(c)
        own = time_s[part]
        right = np.clip(np.searchsorted(own, time_s[mine]), 1, max(1, len(own) - 1))
        right = np.minimum(right, len(own) - 1)
        left = np.maximum(right - 1, 0)
        near = np.where(time_s[mine] - own[left] < own[right] - time_s[mine], left, right)
        close = np.abs(own[near] - time_s[mine]) <= 0.5 / camera.frame_rate + 1e-9
        out[close, c] = part.start + near[close]
    return out


def points_of(frames: Frames, partners: Ints, time_s: Floats, target: int) -> tuple[Floats, Floats]:
    """Common times (p,) and points (p, 3) of one target, from every instant at which two or more cameras see it."""
    sees = (partners >= 0) & frames.seen[partners, target]
    gain = frames.gain[partners, target] @ frames.cam_from_enu[partners] * sees[..., None, None]
    flat = np.swapaxes(gain, -1, -2) @ gain
    normal = flat.sum(axis=1)
    right = (flat @ frames.position_m[partners][..., None])[..., 0].sum(axis=1)
    value = np.linalg.eigvalsh(normal)
    good = (sees.sum(axis=1) >= 2) & (value[:, 0] > FLATTEST * value[:, 2])
    if not good.any():
        raise GeometryError(
            where=f"triangulation of {frames.targets[target]}",
            seen="no two synchronised frames whose rays cross",
            expected="frames of two cameras at the same time that both see the target",
            advice="a method for asynchronous cameras: intersection with known offsets, or map",
        )
    points = np.linalg.solve(normal[good], right[good][..., None])[..., 0]
    shared = np.where(partners >= 0, time_s[partners], np.nan)
    return np.asarray(np.nanmean(shared[good], axis=1)), points


def _through(model: Model, n: int, time: Floats, points: Floats) -> tuple[Floats, Floats, float]:
    """Coefficients (count, 3) through points, their covariance (count, count) per axis, half the sum of squares."""
    t = model.basis.targets[n]
    span = model.basis.span(time)
    u = (time - model.basis.mid_s[span]) / model.basis.half_s[span]
    value = np.einsum("bij,bi->bj", t.transform[span], u[:, None] ** np.arange(model.basis.degree + 1))
    design = np.zeros((len(time), t.count))
    design[np.arange(len(time))[:, None], t.active[span][:, None] - t.first + np.arange(t.degree + 1)] = value
    normal = design.T @ design
    if t.kind == "spline":
        first, rows, _ = jerk_penalty(model, n)
        for begin, row in zip(first - t.first, rows[..., 0], strict=True):
            normal[begin : begin + len(row), begin : begin + len(row)] += np.outer(row, row)
    if np.linalg.matrix_rank(normal, hermitian=True) < t.count:
        raise GeometryError(
            where=f"triangulation of {t.target}", seen=f"{len(time)} points",
            expected=f"at least {t.count} at different times", advice="a lower motion order, or more frames",
        )  # fmt: skip
    inverse = np.linalg.inv(normal)
    coefficients = inverse @ design.T @ points
    square = float(((design @ coefficients - points) ** 2).sum())
    redundancy = max(1, 3 * (len(time) - t.count))
    return coefficients, inverse * square / redundancy, 0.5 * square
