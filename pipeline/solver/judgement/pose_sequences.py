"""The pose errors of a camera's frames as a sequence: do they step, drift, or go together?

A frame's estimated error u (6, in prior sigmas) is the score of a shift of its prior mean, with the information
W = I - H^-1, H the frame's own normal matrix with its prior. So for a constant (which is the camera's bias and not
looked at), a step after frame k, and a ramp,

    S_k = sum over f <= k of u_f - V_k V_n^-1 S_n     V_k = sum of W_f      cov S_k = V_k - V_k V_n^-1 V_k

and S' cov^-1 S is what chi-square would fall by if the prior had that step; cov^-1 S is the step. What the other
unknowns take up only makes the sums smaller, so the chances said here are upper bounds. Neighbours: sums over short
stretches, multiplied with the next stretch's, have mean zero and variance tr(W_j W_j+1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.model import Model, State, pose_error
from pipeline.solver.judgement.prior_tests import log10_chance
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS, FOCAL, common_time_s
from pipeline.solver.observation.residuals import linearise, place_shift

MOST_FRAMES = 3000
"""Frames of a camera that are looked at, evenly spread; an hour's flight has 90,000."""
PLACES = 60
"""Places at which a step is looked for."""
STRETCHES = 12
"""Stretches whose sums are compared with their neighbours', for slow wander."""
Kind = Literal["step", "drift", "alike"]
Part = Literal["attitude", "position"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequence:
    """What is found in one camera's pose errors.

    kind       "step", "drift" (first to last), "alike" (neighbours go together)
    part       of the pose that explains it best
    frame, time_s   where a step is (first frame after it); the first frame otherwise
    size       (3,) rad in camera axes or metres ENU: the step, or the way from first to last; NaN for "alike"
    statistic, log10_p   chi-square of six degrees of freedom and its chance, all places together
    correlation  of neighbours, for "alike"
    """

    camera: str
    kind: Kind
    part: Part
    frame: int
    time_s: float
    size: Floats
    statistic: float
    log10_p: float
    correlation: float = np.nan


def own_information(model: Model, state: State, chosen: Ints) -> Floats:
    """(f, 6, 6): I - H^-1 of frames `chosen`, what their sightings say of their own errors."""
    frames = model.frames
    camera = frames.camera[chosen]
    spread = model.pose.spread[camera]
    error = pose_error(model, state, chosen)
    time = common_time_s(frames, model.drift, state.camera, state.deviation)[chosen]
    target_m = model.basis.position(time, state.coefficients)
    line = linearise(frames, chosen, target_m, error, state.camera[camera, FOCAL])  # type: ignore[arg-type]
    residual: Floats = line.residual
    if state.camera.shape[1] > CAMERA_PARAMETERS and frames.angular:
        residual = np.add(residual, place_shift(frames, chosen, state.camera))  # type: ignore[arg-type]
    weight = model.loss.weight((residual**2).sum(-1)) * frames.seen[chosen]
    own = line.by_pose * spread[:, None, None] * np.sqrt(weight)[..., None, None]
    own = own.reshape(len(chosen), -1, 6)
    data = np.swapaxes(own, 1, 2) @ own
    return np.asarray(np.eye(6) - np.linalg.inv(data + np.eye(6)))


def pose_sequences(model: Model, state: State) -> tuple[Sequence, ...]:
    """What stands out in every camera whose frames have errors of their own, the most unlikely first."""
    found: list[Sequence] = []
    for c in range(len(model.frames.cameras)):
        part = model.frames.of(c)
        count = part.stop - part.start
        if count >= 8 and model.pose.spread[c].any() and model.pose.prior[c].all():
            chosen = part.start + np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(np.int64))
            found += _of_camera(model, state, c, chosen)
    return tuple(sorted(found, key=lambda s: s.log10_p))


def _of_camera(model: Model, state: State, c: int, chosen: Ints) -> list[Sequence]:
    u, information = state.own[chosen], own_information(model, state, chosen)
    spread, frames = model.pose.spread[c], model.frames
    video = frames.video_s[chosen]
    places = np.unique(np.linspace(0.04 * len(u), 0.96 * len(u), PLACES).astype(np.int64))
    step = np.zeros((len(places), len(u)))
    for row, k in enumerate(places):
        step[row, k:] = 1.0
    ramp = ((video - video[0]) / max(float(np.ptp(video)), 1e-9))[None]
    found = []
    for kind, shapes in (("step", step), ("drift", ramp)):
        scores, covariances = _scores(u, information, shapes)
        chi = np.array([_square(s, v) for s, v in zip(scores, covariances, strict=True)])
        best = int(chi.argmax())
        part, size = _explained(scores[best], covariances[best], spread)
        at = int(chosen[places[best]]) if kind == "step" else int(chosen[0])
        many = np.log10(len(shapes))
        found.append(
            Sequence(
                camera=frames.cameras[c], kind=kind, part=part, frame=int(frames.frame[at]),  # type: ignore[arg-type]
                time_s=float(frames.video_s[at]), size=size, statistic=float(chi[best]),
                log10_p=min(0.0, log10_chance(float(chi[best]), 6) + many),
            )
        )  # fmt: skip
    lasting = None if model.wander is None else model.wander.of(c)
    if lasting is not None and lasting.stop > lasting.start:
        return found  # its errors are taken to last already: what is left goes with the errors of the tracks
    return [*found, *_alike(frames.cameras[c], int(frames.frame[chosen[0]]), float(video[0]), u, information)]


def _scores(u: Floats, information: Floats, shapes: Floats) -> tuple[Floats, Floats]:
    """(s, 6) scores of `shapes` (s, n), made free of a constant, and their covariances (s, 6, 6)."""
    total, level = information.sum(axis=0), u.sum(axis=0)
    inverse = np.linalg.pinv(total, rcond=1e-9, hermitian=True)
    first = np.einsum("sf,fij->sij", shapes, information)
    second = np.einsum("sf,fij->sij", shapes**2, information)
    scores = shapes @ u - first @ inverse @ level
    return scores, second - first @ inverse @ np.swapaxes(first, 1, 2)


def _square(score: Floats, covariance: Floats) -> float:
    """score' covariance^-1 score over the directions that the sightings see at all."""
    value, vector = np.linalg.eigh(0.5 * (covariance + covariance.T))
    seen = value > max(1e-6 * value.max(), 1e-9)
    return float(((vector[:, seen].T @ score) ** 2 / value[seen]).sum())


def _explained(score: Floats, covariance: Floats, spread: Floats) -> tuple[Part, Floats]:
    """Which half of the pose explains a score best, and the size it then has."""
    halves: dict[Part, slice] = {"attitude": slice(0, 3), "position": slice(3, 6)}
    held = {part: own for part, own in halves.items() if spread[own].any()}
    best = max(held, key=lambda part: _square(score[held[part]], covariance[held[part], held[part]]))
    own = halves[best]
    inverse = np.linalg.pinv(covariance[own, own], rcond=1e-6, hermitian=True)
    return best, np.asarray(spread[own] * (inverse @ score[own]))


def _alike(camera: str, frame: int, time_s: float, u: Floats, information: Floats) -> list[Sequence]:
    """Neighbours, frame by frame and in long stretches."""
    found = []
    for pieces in {len(u), min(len(u), STRETCHES * 5), min(len(u), STRETCHES)}:
        cut = np.unique(np.linspace(0, len(u), pieces + 1).astype(np.int64))[:-1]
        sums, weight = np.add.reduceat(u, cut, axis=0), np.add.reduceat(information, cut, axis=0)
        total = np.linalg.pinv(weight.sum(axis=0), rcond=1e-9, hermitian=True)
        sums = sums - weight @ (total @ u.sum(axis=0))
        product, variance = (sums[1:] * sums[:-1]).sum(axis=1), np.einsum("fij,fij->f", weight[1:], weight[:-1])
        z = float(product.sum() / np.sqrt(max(variance.sum(), 1e-12)))
        correlation = float(product.sum()) / max(float((sums**2).sum()), 1e-12)
        known = float(np.trace(weight, axis1=1, axis2=2).sum()) * len(cut) / len(u)
        found.append((z, correlation, known))
    z, correlation, known = max(found)
    return [
        Sequence(
            camera=camera, kind="alike", part="position", frame=frame, time_s=time_s, size=np.full(3, np.nan),
            statistic=-known * float(np.log1p(-min(correlation, 0.99) ** 2)),
            log10_p=min(0.0, log10_chance(z * z, 1) + np.log10(1.5)) if z > 0 else 0.0, correlation=correlation,
        )
    ]  # fmt: skip
