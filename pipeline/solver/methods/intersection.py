"""Trajectory intersection: the motion alone, every time and pose known (paper eq. 6 to 8).

V (X(t) - C) = 0 is linear in the motion's coefficients, so one step of the common machinery solves it, for one camera
or many, polynomial or spline. Triangulation is the same for a single instant: one point, order 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.solver.adjustment.assembly import linear, moved
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.compiled_descent import is_dense, motion_step
from pipeline.solver.adjustment.elimination import Loss, PoseError
from pipeline.solver.adjustment.log_poses import Renew
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import FOCAL, ROT, common_time_s
from pipeline.solver.observation.observations import Frames, metric, scaled_metric

RANK = 1e-12
"""Relative to its diagonal, the smallest pivot of a motion that counts as determined."""
REWEIGHTED = 2
RENEWED = 3
"""How often sightings are taken anew at their rows' instants: each time leaves a thousandth of what was missed."""
SINGULAR = "the normal equations of the motion are singular"


def held_poses(cameras: int) -> PoseError:
    """No frame has a pose error of its own."""
    return PoseError(spread=np.zeros((cameras, 6)), prior=np.ones((cameras, 6)))


def intersect(model: Model, state: State) -> State:
    """The motion that fits best at the state's clocks and poses, in metres (paper eq. 8).

    Raises GeometryError where the rays do not determine it.
    """
    return _motion_step(model, model.frames, state)


def intersected(model: Model, state: State, renew: Renew | None) -> tuple[Model, State]:
    """`intersect` with the model's data taken anew at what it finds, where they depend on it; that model, the state."""
    found = intersect(model, state)
    for _ in range(RENEWED if renew is not None else 0):
        assert renew is not None
        model = renew(model, found)
        found = intersect(model, found)
    return model, found


def intersect_weighted(model: Model, state: State) -> State:
    """The same with every ray weighted by what it is worth at its target's distance: a start for `map`.

    A camera's unknown constant rotation counts as noise here, or the motion would bend to please every camera.
    """
    precision = model.priors.camera_precision[:, ROT].min(axis=1)
    bias_rad = np.asarray(np.where(precision > 0, 1 / np.sqrt(np.maximum(precision, 1e-12)), 0.0))
    found = intersect(model, state)
    for _ in range(REWEIGHTED):
        frames = scaled_metric(model.frames, distance_m(model, found), bias_rad)
        found = _motion_step(model, frames, found)
    return found


def distance_m(model: Model, state: State) -> Floats:
    """Distance (F, N) of every target from every camera position, at least half of that camera's median."""
    frames = model.frames
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    away = model.basis.position(time, state.coefficients) - frames.position_m[:, None]
    distance: Floats = np.linalg.norm(away, axis=-1)
    out: Floats = np.empty_like(distance)
    for c in range(len(frames.cameras)):
        own = distance[frames.of(c)]
        out[frames.of(c)] = np.maximum(own, max(1.0, 0.5 * float(np.median(own))))
    return out


def _motion_step(model: Model, frames: Frames, state: State) -> State:
    """One linear step of the motion alone; residuals of `frames` that are angular are made metric."""
    plain_lenses = len(frames.focal_effect) == 0 or not state.camera[:, FOCAL].any()
    if model.motion_free and model.known is None and plain_lenses and is_dense(model):
        found, pivot = motion_step(model, state, frames, RANK)
        _check_pivot(pivot)
        return replace(state, coefficients=found)
    held = replace(model.priors, camera_free=np.zeros_like(model.priors.camera_free))
    alone = model.changed(
        frames=metric(frames) if frames.angular else frames,
        priors=held,
        pose=held_poses(len(frames.cameras)),
        loss=Loss(),
        drift_free=False,
        motion_free=True,
    )
    here = linear(alone, state)
    diagonal = here.system.diagonal
    if not (diagonal > 0).all():
        _check_pivot(-1.0)
    scale = 1 / np.sqrt(diagonal)
    factor = factorise(here.system.scaled(scale).damped(np.full(len(scale), RANK)))
    if factor is None:
        raise not_determined(SINGULAR)
    _check_pivot(factor.smallest_pivot())
    return moved(alone, here, -scale * factor.solve(scale * here.system.gradient))


def _check_pivot(pivot: float) -> None:
    """Raises where the smallest squared pivot says that the rays do not determine the motion; -1: one was empty."""
    if pivot < 0:
        raise not_determined("some coefficients of the motion touch no sight ray")
    if pivot == 0:
        raise not_determined(SINGULAR)
    if not pivot > 10 * RANK:
        raise not_determined("the sight rays leave a direction of the motion free")


def not_determined(seen: str) -> GeometryError:
    """The motion cannot be found from these rays."""
    return GeometryError(
        where="trajectory intersection",
        seen=seen,
        expected="3 (order + 1) / 2 sightings of each target, from a path less simple than the target's",
        advice="a lower motion order, more frames, another camera, or the method 'map' with priors",
    )
