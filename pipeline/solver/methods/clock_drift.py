"""Which clocks drift, said by the data, and the knots they are then given.

After an adjustment with affine clocks, the sightings of a camera over each stretch of ten seconds ask for a small time
deviation of their own, d = - sum w J r / sum w J^2 with J = dr/dt, whose sigma comes from sums over single seconds
(errors inside a second are alike). Of an affine clock these are independent; of a drifting one neighbours agree. The
test is the sum of products of neighbours, z_i z_(i+1), over the spread that it would have if they were independent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Finding, Problem
from pipeline.solver.adjustment.model import Model, State, pose_error, residuals_of
from pipeline.solver.observation.clocks import FOCAL, Drift, common_time_s, drift_knots
from pipeline.solver.observation.residuals import linearise

STRETCH_S, CLUSTER_S, KNOTS_S = 10.0, 1.0, 10.0
FEWEST = 8
"""Stretches below which nothing is decided."""
AGREEMENT = 6.0
"""Sigmas of agreement between neighbours at which a clock is called drifting. On real flights lens errors and labels
that are off for long bring steady clocks up to five."""
FIRST_WALK = 2e-3
"""s / sqrt(s), before the data say."""
CLIPPED, STEP_S = 4.0, 1e-3


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far neighbouring stretches of a camera agree on a time deviation, in sigmas; and its size (rms)."""

    sigmas: float
    rms_s: float


def agreement(model: Model, state: State, camera: int) -> Agreement | None:
    """The test for one camera; None where its sightings are too few."""
    frames, part = model.frames, model.frames.of(camera)
    time = common_time_s(frames, model.drift, state.camera, state.deviation)[part]
    position = model.basis.position(time, state.coefficients)
    ahead, behind = (model.basis.position(time + s, state.coefficients) for s in (STEP_S, -STEP_S))
    velocity = (ahead - behind) / (2 * STEP_S)
    error = pose_error(model, state, part)
    found = linearise(frames, part, position, error, np.full(len(time), state.camera[camera, FOCAL]))
    residual = residuals_of(frames, part, model, state)
    by_time = (found.by_position @ velocity[..., None])[..., 0]
    weight = model.loss.weight((residual**2).sum(-1))
    pull = (weight * (by_time * residual).sum(-1)).sum(-1)
    worth = (weight * (by_time**2).sum(-1)).sum(-1)
    return _agreement(frames.video_s[part], pull, worth)


def _agreement(video_s: Floats, pull: Floats, worth: Floats) -> Agreement | None:
    second, place = np.unique(np.floor(video_s / CLUSTER_S), return_inverse=True)
    clusters, worths = np.bincount(place, pull), np.bincount(place, worth)
    stretch = np.floor(second * CLUSTER_S / STRETCH_S).astype(np.int64)
    number = stretch - stretch.min()
    noise = np.sqrt(np.bincount(number, clusters**2))
    total, value = np.bincount(number, worths), np.bincount(number, clusters)
    known = (np.bincount(number) >= 3) & (noise > 0)
    z = np.where(known, np.clip(-value / np.where(known, noise, 1.0), -CLIPPED, CLIPPED), 0.0)
    both = known[:-1] & known[1:]
    if both.sum() < FEWEST:
        return None
    product = (z[:-1] * z[1:])[both]
    deviation = value[known] / total[known]
    rms = float(np.sqrt((deviation**2 * total[known]).sum() / total[known].sum()))
    return Agreement(sigmas=float(product.sum() / np.sqrt(len(product))), rms_s=rms)


def drifting(problem: Problem, model: Model, state: State) -> tuple[tuple[int, ...], tuple[Finding, ...]]:
    """Cameras whose clocks shall drift, by order or by the data, and why, in words."""
    chosen, findings = [], []
    for c, camera in enumerate(problem.cameras):
        if camera.camera == problem.reference_camera or camera.clock == "affine":
            continue
        found = agreement(model, state, c)
        if camera.clock == "drift" or (found is not None and found.sigmas > AGREEMENT):
            chosen.append(c)
        if camera.clock == "auto" and found is not None:
            findings.append(_said(camera.camera, found))
    return tuple(chosen), tuple(findings)


def _said(camera: str, found: Agreement) -> Finding:
    drifts = found.sigmas > AGREEMENT
    words = (
        f"the clock of {camera} drifts: neighbouring stretches of {STRETCH_S:.0f} s agree on time deviations of "
        f"{1e3 * found.rms_s:.1f} ms ({found.sigmas:.1f} sigma)"
        if drifts
        else f"the clock of {camera} is taken as affine: time deviations of neighbouring stretches of "
        f"{STRETCH_S:.0f} s do not agree ({found.sigmas:.1f} sigma)"
    )
    return Finding(kind="clock-drifts" if drifts else "clock-affine", subject=camera, words=words)


def with_drift(model: Model, state: State, cameras: tuple[int, ...]) -> tuple[Model, State]:
    """The model with deviations of these cameras' clocks, all zero yet."""
    drift: Drift = drift_knots(model.frames, dict.fromkeys(cameras, KNOTS_S))
    priors = replace(model.priors, drift_rate=np.full(len(model.frames.cameras), FIRST_WALK))
    return model.changed(drift=drift, priors=priors), replace(state, deviation=np.zeros(drift.count))
