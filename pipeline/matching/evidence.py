"""How well two tracks agree, as a log-likelihood ratio: one target, against two.

Miss and height over time, whitened by their noise, are seen as Legendre polynomials c_0 ... c_4 of the time in common;
what is faster is noise under either hypothesis. One target: the coefficients are what instruments and places on the
target are worth. Two targets: they are as large as scenes, velocities and turns are, in one of a few ways (free, alike,
both standing still), each with its share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.matching.settings import MatchSettings


@dataclass(frozen=True, kw_only=True, eq=False)
class Polynomials:
    """Of pairs of tracks (..., n): basis (..., n, P) whitened, inverse normal matrix (..., P, P), half time (...)."""

    basis: Floats
    inverse: Floats
    half_s: Floats

    def of(self, value: Floats, weight: Floats) -> Floats:
        """Coefficients (..., P) of values (..., n) by their weights, 1 / sigma (..., n), 0 where missing."""
        moment = np.einsum("...np,...n->...p", self.basis, np.where(weight > 0, value, 0.0) * weight)
        found: Floats = np.einsum("...pq,...q->...p", self.inverse, moment)
        return found


WEAK = 1e-7
"""Information per coefficient, 1 / m^2, that is always added: what was never seen is unknown, not singular."""


def polynomials(time_s: Floats, weight: Floats, orders: int) -> Polynomials:
    """The polynomials of pairs over the times (n,) they have in common: weights (..., n), 0 where they have none."""
    seen = weight > 0
    first = np.min(np.where(seen, time_s, np.inf), axis=-1)
    last = np.max(np.where(seen, time_s, -np.inf), axis=-1)
    first, last = (np.where(np.isfinite(edge), edge, time_s.mean()) for edge in (first, last))
    half, middle = np.maximum(0.5 * (last - first), 1e-3), 0.5 * (last + first)
    x = np.clip((time_s - middle[..., None]) / half[..., None], -1, 1)
    basis = legendre(x, orders) * weight[..., None]
    information = np.einsum("...np,...nq->...pq", basis, basis) + WEAK * np.eye(orders)
    return Polynomials(basis=basis, inverse=np.linalg.inv(information), half_s=half)


def legendre(x: Floats, orders: int) -> Floats:
    """P_0 ... P_(orders - 1) at x: (..., orders)."""
    found = [np.ones_like(x), x]
    for k in range(1, orders - 1):
        found.append(((2 * k + 1) * x * found[k] - k * found[k - 1]) / (k + 1))
    return np.stack(found[:orders], axis=-1)


MOVED_ROUND = (1.0, 0.3, 0.1, 0.05, 0.0)
"""How two things that stand apart look while cameras move around them."""
SHAPES = (1.0, 1.0, 1 / 3, 1 / 15, 1 / 105)
"""Legendre coefficient k of t^k / k! on -1 to 1."""


def different_m(half_s: Floats, settings: MatchSettings, kind: str) -> Floats:
    """One sigma (..., P) of the coefficients of two different targets, metres; `kind` is one of `sweep.kinds`."""
    if kind == "near":
        return np.asarray(settings.near_m / settings.apart_m * different_m(half_s, settings, "still"))
    if kind == "wild":
        return np.asarray(settings.wild_factor * different_m(half_s, settings, "free"))
    if kind == "still":
        return np.asarray(settings.apart_m * np.ones((*half_s.shape, 1)) * np.array(MOVED_ROUND)[: settings.orders])
    if kind == "alike":
        rates = (settings.apart_m, settings.alike_mps, settings.alike_mps2, 0.3 * settings.alike_mps2, 0.0)
    else:
        rates = (settings.apart_m, settings.speed_mps, settings.bend_mps2, 0.3 * settings.bend_mps2, 0.1)
    grown = [
        np.minimum(rate * shape * half_s**k, settings.apart_m)
        for k, (rate, shape) in enumerate(zip(rates, SHAPES, strict=True))
    ]
    return np.stack(grown, axis=-1)[..., : settings.orders]


def log_ratio(coefficient: Floats, noise: Floats, same: Floats, other: Floats) -> Floats:
    """Log-likelihood (..., P) of coefficients under `same` less that under `other`; all variances, m^2."""
    narrow, wide = noise + same, noise + same + other
    found: Floats = 0.5 * (np.log(wide / narrow) - coefficient**2 * (1 / narrow - 1 / wide))
    return found
