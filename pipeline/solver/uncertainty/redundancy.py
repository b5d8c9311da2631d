"""How much of every camera's and every target's sightings is left over to check the rest.

With A the derivatives of the whitened sightings by all unknowns, frames' own pose errors among them, and N the normal
matrix with all priors, a sighting's share of its own adjustment is its leverage, a diagonal element of A N^-1 A'. With
P = J_f H^-1 J_f' of a frame, J its derivatives by everything else and C the covariance of that,

    leverage = diag(P + (I - P) J C J' (I - P)),      redundancy of a group = equations - its sum of leverages

which is also what its sum of squared residuals is on average. At most `FRAMES` frames of a camera, evenly spread, are
looked at and stand for the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.records import Redundancy
from pipeline.solver.adjustment.model import Model, State, pose_error
from pipeline.solver.observation.clocks import (
    CAMERA_PARAMETERS,
    FOCAL,
    OFFSET,
    POS,
    READOUT,
    ROT,
    SCALE,
    START,
    common_time_s,
)
from pipeline.solver.observation.motion_basis import covered
from pipeline.solver.observation.residuals import Linearised, linearise
from pipeline.solver.uncertainty.covariance import Covariance

FRAMES = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class RedundancyTable:
    """By camera and target.

    seen  (C, N) equations, two a sighting; left (C, N) their redundancy; off (C, N) their sum of squares
    own   (C,) what the frames' own errors' squares, in prior sigmas, sum to on average
    """

    seen: Floats
    left: Floats
    off: Floats
    own: Floats


def redundancies(model: Model, state: State, covariance: Covariance, square: Floats) -> tuple[Redundancy, ...]:
    """Of every camera, then of every target; `square` (F, N) are squared residuals in sigmas."""
    frames = model.frames
    table = redundancy_table(model, state, covariance, square)
    seen, left, off = table.seen, table.left, table.off
    return (
        *(_record("camera", name, seen[c], left[c], off[c]) for c, name in enumerate(frames.cameras)),
        *(_record("target", name, seen[:, n], left[:, n], off[:, n]) for n, name in enumerate(frames.targets)),
    )


def redundancy_table(model: Model, state: State, covariance: Covariance, square: Floats) -> RedundancyTable:
    """Of every track of a target in a camera; `square` (F, N) are squared residuals in sigmas."""
    frames = model.frames
    shape = (len(frames.cameras), len(frames.targets))
    seen, left, off, own = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape[0])
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    for c in range(shape[0]):
        part = frames.of(c)
        seen[c] = 2 * frames.seen[part].sum(axis=0)
        off[c] = (square[part] * frames.seen[part]).sum(axis=0)
        count = part.stop - part.start
        chosen = part.start + np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(np.int64))
        leverage, known = _leverages(model, state, covariance, chosen, time[chosen], square[chosen])
        looked = 2 * frames.seen[chosen].sum(axis=0)
        left[c] = seen[c] * (1 - leverage.sum(axis=(0, 2)) / np.maximum(looked, 1))
        own[c] = count * known.mean()
    return RedundancyTable(seen=seen, left=left, off=off, own=own)


def _record(kind: Literal["camera", "target"], subject: str, seen: Floats, left: Floats, off: Floats) -> Redundancy:
    return Redundancy(
        kind=kind, subject=subject, equations=int(seen.sum()), redundancy=float(left.sum()), chi_square=float(off.sum())
    )


def _leverages(
    model: Model, state: State, covariance: Covariance, chosen: Ints, time_s: Floats, square: Floats
) -> tuple[Floats, Floats]:
    """(f, N, 2) of frames `chosen` of one camera, zero where nothing is seen; and what of the frames' own errors is
    known on average (f,): their prior variance less their posterior one."""
    frames = model.frames
    f, n = frames.seen[chosen].shape
    spread = model.pose.spread[frames.camera[chosen]]
    focal = state.camera[frames.camera[chosen], FOCAL]
    error = pose_error(model, state, chosen)
    target_m = model.basis.position(time_s, state.coefficients)
    line = linearise(frames, chosen, target_m, error, focal)  # type: ignore[arg-type]
    root = np.sqrt(model.loss.weight(square) * frames.seen[chosen])[..., None, None]
    own = (line.by_pose * spread[:, None, None] * root).reshape(f, 2 * n, 6)
    normal = np.swapaxes(own, 1, 2) @ own + model.pose.prior[frames.camera[chosen]][:, :, None] * np.eye(6)
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    taken = own @ inverse @ np.swapaxes(own, 1, 2)
    shared, places = _by_shared(model, state, chosen, time_s, line)
    weighted = (shared * root).reshape(f, 2 * n, -1)
    rest = (np.eye(2 * n) - taken) @ weighted
    follows = inverse @ np.swapaxes(own, 1, 2) @ weighted
    has_prior = model.pose.prior[frames.camera[chosen]] * (spread > 0)
    known = ((1 - np.diagonal(inverse, axis1=1, axis2=2)) * has_prior).sum(axis=1)
    out = np.diagonal(taken, axis1=1, axis2=2).copy()
    kinds, which = np.unique(places, axis=0, return_inverse=True)
    for k, place in enumerate(kinds):
        free, mine = place >= 0, which.ravel() == k
        own_rows = rest[mine][..., free]
        own_c = covariance.pairs(place[free][:, None], place[free][None, :])
        out[mine] += ((own_rows @ own_c) * own_rows).sum(axis=-1)
        moved = follows[mine][..., free]
        known[mine] -= (((moved @ own_c) * moved).sum(axis=-1) * has_prior[mine]).sum(axis=-1)
    return out.reshape(f, n, 2) * frames.seen[chosen][..., None], known


def _by_shared(model: Model, state: State, chosen: Ints, time_s: Floats, line: Linearised) -> tuple[Floats, Ints]:
    """Derivatives (f, N, 2, G) by all that is not a frame's own, and the places (f, G) of those unknowns."""
    frames, basis, drift = model.frames, model.basis, model.drift
    f, n = frames.seen[chosen].shape
    span = basis.span(time_s)
    u = (time_s - basis.mid_s[span]) / basis.half_s[span]
    powers = u[:, None] ** np.arange(basis.degree + 1)
    step = 1e-4 * float(basis.half_s.min())
    ahead, behind = (basis.position(time_s + s, state.coefficients) for s in (step, -step))
    by_time = (line.by_position @ ((ahead - behind) / (2 * step))[..., None])[..., 0]
    columns, places = [], []
    everywhere = all(covered(basis, t).all() for t in basis.targets)  # else the band may not reach from one to another
    for k, t in enumerate(basis.targets):
        value = np.einsum("fi,fij->fj", powers, t.transform[span])
        block = np.zeros((f, n, 2, 3, t.degree + 1))
        block[:, k] = line.by_position[:, k, :, :, None] * value[:, None, None, :]
        columns.append(block.reshape(f, n, 2, -1))
        acting = model.order.coefficient[t.active[span][:, None] + np.arange(t.degree + 1)]
        if not everywhere:
            acting = np.where(frames.seen[chosen, k, None, None], acting, -1)
        places.append(np.swapaxes(acting, 1, 2).reshape(f, -1))
    log_time = by_time + line.by_pose_time
    tau = frames.video_s[chosen]
    camera = np.zeros((f, n, 2, state.camera.shape[1]))
    camera[..., ROT], camera[..., POS], camera[..., FOCAL] = line.by_pose[..., :3], line.by_pose[..., 3:], line.by_focal
    camera[..., OFFSET], camera[..., SCALE] = by_time, log_time * tau[:, None, None]
    camera[..., START] = line.by_pose_time
    if len(frames.by_readout):
        camera[..., READOUT] = frames.by_readout[chosen]
    _add_places(camera[..., CAMERA_PARAMETERS:], frames.place_gain[chosen], frames.place_share[chosen])
    columns.append(camera)
    places.append(model.order.camera[frames.camera[chosen]])
    if model.wander is not None and model.wander.count and (model.wander.left[chosen] >= 0).all():
        left, share = model.wander.left[chosen], model.wander.share[chosen][:, None, None, None]
        columns += [line.by_pose * (1 - share), line.by_pose * share]
        places += [model.order.wander[left], model.order.wander[left + 1]]
    segment = drift.segment[chosen]
    if (segment >= 0).all():
        share = (tau - drift.knot_s[segment]) / (drift.knot_s[segment + 1] - drift.knot_s[segment])
        columns.append(log_time[..., None] * np.stack([1 - share, share], axis=1)[:, None, None])
        places.append(model.order.drift[segment[:, None] + np.arange(2)])
    return np.concatenate(columns, axis=-1), np.concatenate(places, axis=1)


def _add_places(columns: Floats, gain: Floats, share: Floats) -> None:
    """Into zeros (f, N, 2, 4 N), under construction: what a pixel of each target's place errors adds."""
    for k in range(columns.shape[-1] // 4):
        for axis in range(2):
            columns[:, k, axis, 4 * k + 2 * axis] = gain[:, k]
            columns[:, k, axis, 4 * k + 2 * axis + 1] = gain[:, k] * share
