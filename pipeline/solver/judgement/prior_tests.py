"""Is a prior contradicted? What the adjustment takes from a prior has a known variance.

With prior covariance P0 of a block, posterior P (the inverse normal matrix) and S (the sandwich, which counts what
errors have in common), the correction d = estimate - prior mean has, if all is as claimed, the covariance

    D = P0 - P + (S - P)          d' D^-1 d  is chi-square, one degree of freedom for each direction

The same figure is what chi-square would fall by if the block had no prior. Directions of which the sightings say
nothing (D much smaller than P0) are floored: there d is zero but for rounding and curvature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import (
    CAMERA_PARAMETERS,
    FOCAL,
    OFFSET,
    PLACE_PARAMETERS,
    POS,
    READOUT,
    ROT,
    SCALE,
    START,
)
from pipeline.solver.uncertainty.covariance import Covariance

FLOOR = 0.02
"""Least share of a prior's variance that a correction is granted; doubled, hardly seen directions tell half as much."""
BLOCKS: dict[str, list[int]] = {
    "attitude": [*range(ROT.start, ROT.stop)],
    "position": [*range(POS.start, POS.stop)],
    "focal": [FOCAL],
    "offset": [OFFSET],
    "frame-rate": [SCALE],
    "start": [START],
    "readout": [READOUT],
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PriorTest:
    """One block of one camera's parameters against its prior.

    what        "attitude", "position", "focal", "offset", "frame-rate", "start", "readout" or "place"
    columns     (k,) of the camera's parameters
    correction  (k,) estimate less prior mean, in the adjustment's units; sigma (k,) of the prior
    statistic   chi-square with `freedom` degrees of freedom
    log10_p     chance of one at least as large, as a power of ten
    """

    camera: str
    what: str
    columns: Ints
    correction: Floats
    sigma: Floats
    statistic: float
    freedom: int
    log10_p: float

    @property
    def in_sigmas(self) -> float:
        """Length of the correction in prior sigmas."""
        return float(np.linalg.norm(self.correction / self.sigma))


def prior_tests(model: Model, state: State, plain: Covariance, robust: Covariance | None) -> tuple[PriorTest, ...]:
    """Every block of every camera that is free and has a prior, the most unlikely first."""
    priors, found = model.priors, []
    known = model.priors.camera_free & (priors.camera_precision > 0)
    for c, camera in enumerate(model.frames.cameras):
        for what, columns in _blocks(state.camera.shape[1]):
            own = np.array([k for k in columns if known[c, k]], dtype=np.int64)
            if len(own):
                found.append(_tested(camera, what, model, state, plain, robust, c, own))
    return tuple(sorted(found, key=lambda t: t.log10_p))


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightTest:
    """A camera's height against the others': what all have in common no sighting sees, nor a test of one camera.

    others        against whose mean height it is held
    difference_m  how much more it was moved up than they; sigma_m what the priors allow
    log10_p       chance of as much either way, as a power of ten
    """

    camera: str
    others: tuple[str, ...]
    difference_m: float
    sigma_m: float
    z: float
    log10_p: float


def height_tests(model: Model, state: State, plain: Covariance, robust: Covariance | None) -> tuple[HeightTest, ...]:
    """Every camera against the others, of two cameras the second alone, the most unlikely first."""
    up, cameras, priors = POS.stop - 1, model.frames.cameras, model.priors
    if not (priors.camera_free[:, up] & (priors.camera_precision[:, up] > 0)).all() or len(cameras) < 2:
        return ()
    place, prior = model.order.camera[:, up], 1 / priors.camera_precision[:, up]
    left = plain.pairs(place[:, None], place[None, :])
    both = left if robust is None else robust.pairs(place[:, None], place[None, :])
    correction, found = state.camera[:, up] - priors.camera_mean[:, up], []
    for c in range(1 if len(cameras) == 2 else 0, len(cameras)):
        weight = np.full(len(cameras), -1 / (len(cameras) - 1))
        weight[c] = 1.0
        allowed = float(weight**2 @ prior)
        variance = allowed - float(weight @ left @ weight) + max(0.0, float(weight @ (both - left) @ weight))
        z = float(weight @ correction) / float(np.sqrt(max(variance, FLOOR * allowed)))
        others = tuple(name for k, name in enumerate(cameras) if k != c)
        found.append(
            HeightTest(
                camera=cameras[c], others=others, difference_m=float(weight @ correction),
                sigma_m=float(np.sqrt(allowed)), z=z, log10_p=log10_chance(z * z, 1),
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda t: t.log10_p))


def _blocks(width: int) -> Sequence[tuple[str, list[int]]]:
    places = range(CAMERA_PARAMETERS, width, PLACE_PARAMETERS)
    return [*BLOCKS.items(), *(("place", [*range(k, k + PLACE_PARAMETERS)]) for k in places)]


def _tested(
    camera: str, what: str, model: Model, state: State, plain: Covariance, robust: Covariance | None, c: int, own: Ints
) -> PriorTest:
    place = model.order.camera[c, own]
    sigma = model.priors.camera_precision[c, own] ** -0.5
    correction = state.camera[c, own] - model.priors.camera_mean[c, own]
    left = plain.pairs(place[:, None], place[None, :]) / np.outer(sigma, sigma)
    variance = np.eye(len(own)) - left
    if robust is not None:
        variance += positive_part(robust.pairs(place[:, None], place[None, :]) / np.outer(sigma, sigma) - left)
    statistic = whitened_square(correction / sigma, variance)
    return PriorTest(
        camera=camera, what=what, columns=own, correction=correction, sigma=sigma, statistic=statistic,
        freedom=len(own), log10_p=log10_chance(statistic, len(own)),
    )  # fmt: skip


def positive_part(matrix: Floats) -> Floats:
    """The part of a symmetric matrix whose eigenvalues are positive."""
    value, vector = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vector * np.maximum(value, 0)) @ vector.T)


def whitened_square(value: Floats, variance: Floats, floor: float = FLOOR) -> float:
    """value' variance^-1 value with the variance's eigenvalues floored."""
    size, vector = np.linalg.eigh(0.5 * (variance + variance.T))
    return float(((vector.T @ value) ** 2 / np.maximum(size, floor)).sum())


def log10_chance(statistic: float, freedom: int) -> float:
    """Power of ten of the chance that chi-square goes as far; its asymptote where that is too small for a number."""
    chance = float(chdtrc(freedom, statistic)) if np.isfinite(statistic) else 0.0
    if chance > 1e-290:
        return float(np.log10(chance))
    half = 0.5 * min(statistic, 1e12)
    return float(-(half - (0.5 * freedom - 1) * np.log(max(half, 1.0))) / np.log(10))
