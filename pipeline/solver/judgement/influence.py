"""Does a doubt matter? How far the answer moves, in its own claimed sigmas, when what is doubted is left out.

A track may fit worse than its sigmas promise by any chance one likes, and still carry so little weight that the answer
stands. What counts is the displacement d(t) of a target between two adjustments of the same model against its claim,

    root mean square over time of |d(t)| / root tr P(t),        |d offset| / sigma of each clock.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Motion, Solution
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.observation.clocks import OFFSET
from pipeline.solver.observation.motion_basis import TargetBasis, motion_of

TIMES = 50
"""Instants of each motion that are compared."""


def moved_sigmas(before: Fit, after: Fit, solution: Solution) -> float:
    """The greatest of the displacements, in sigmas of `solution`, between two fits of the same unknowns; infinite where
    they are not the same, or nothing is claimed.
    """
    targets = before.model.basis.targets
    same = [t.count for t in targets] == [t.count for t in after.model.basis.targets]
    if not same or before.state.camera.shape != after.state.camera.shape:
        return float("inf")
    claims = [{m.target: m for m in motions} for motions in (solution.motions, solution.motions_robust) if motions]
    moved = [0.0]
    for t in targets:
        own = [claim[t.target] for claim in claims if t.target in claim]
        if not own or own[0].covariance_band is None:
            return float("inf")
        moved.append(motion_sigmas(t, after.state.coefficients - before.state.coefficients, own))
    for c, name in enumerate(before.model.frames.cameras):
        sigma = solution.clock(name).offset_sigma_s
        if sigma > 0:
            moved.append(abs(float(after.state.camera[c, OFFSET] - before.state.camera[c, OFFSET])) / sigma)
    return max(moved)


def motion_sigmas(target: TargetBasis, step: Floats, claims: Sequence[Motion]) -> float:
    """How far a step (P, 3) of all coefficients moves a target, in sigmas of the largest of its `claims`, root mean
    square over their time; each of them has a covariance.
    """
    start_s, end_s = claims[0].start_s, claims[0].end_s
    at = np.linspace(start_s, end_s, TIMES)
    own = step[target.first : target.first + target.count]
    away = motion_of(target, own, None, start_s, end_s).position_enu_m(at)
    variance = np.max([np.einsum("nii->n", m.position_covariance(at)) for m in claims], axis=0)
    return float(np.sqrt(((away**2).sum(axis=1) / np.maximum(variance, 1e-12)).mean()))
