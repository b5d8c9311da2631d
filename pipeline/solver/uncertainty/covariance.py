"""Uncertainty of everything from the factors of the normal equations.

Plain: the inverse of the normal matrix N, of which only a band of blocks and the cameras' block are formed.
Robust (sandwich): N^-1 (sum over clusters of g g' + priors) N^-1, g a cluster's gradient without its own leverage
(`jackknife.py`). Errors of a tracker are alike from frame to frame, so that a cluster's frames (a camera, a stretch
of time) count as one observation of what they have in common; the plain covariance would take them for many.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from scipy.linalg import cho_solve_banded

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.banded_system import Bordered, Factor, band_of_inverse, band_of_sandwich
from pipeline.solver.adjustment.known_rows import add_known
from pipeline.solver.adjustment.model import Model, State, drift_penalty, jerk_penalty
from pipeline.solver.uncertainty.jackknife import freed


class Covariance(Protocol):
    """Covariances of pairs of unknowns by their places."""

    def pairs(self, i: Ints, j: Ints) -> Floats:
        """Covariance of unknowns `i` with `j`, any shape; both in the band only if they act in one span."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Inverse:
    """The inverse of the normal matrix, `scale` times."""

    factor: Factor
    scale: float = 1.0

    @cached_property
    def corner(self) -> Floats:
        """(q, q)."""
        return self.factor.corner_covariance()

    @cached_property
    def _band(self) -> Floats:
        return band_of_inverse(self.factor.band)

    @cached_property
    def _spread(self) -> Floats:
        return np.asarray(self.factor.eliminated @ self.corner)

    def pairs(self, i: Ints, j: Ints) -> Floats:
        """See `Covariance`."""
        i, j = np.broadcast_arrays(i, j)
        n = self.factor.band.shape[1]
        out = np.zeros(i.shape)
        both = (i < n) & (j < n)
        low, high = np.minimum(i, j), np.maximum(i, j)
        if both.any():
            a, b = low[both], high[both]
            coupled = (self._spread[a] * self.factor.eliminated[b]).sum(-1)
            out[both] = self._band[b - a, a] + coupled
        mixed = (low < n) & (high >= n)
        out[mixed] = -self._spread[low[mixed], high[mixed] - n]
        corner = low >= n
        out[corner] = self.corner[i[corner] - n, j[corner] - n]
        return out * self.scale

    def block(self, a: int, b: int, border: Ints) -> Floats:
        """(s, s) rows and columns `a` to `b` of the band, then those of the `border`."""
        size = b - a
        out = np.empty((size + len(border), size + len(border)))
        out[size:, size:] = self.corner[border[:, None], border]
        if size:
            out[:size, :size] = self._of_band(a, b) + self._spread[a:b] @ self.factor.eliminated[a:b].T
            out[:size, size:] = -self._spread[a:b, border]
            out[size:, :size] = out[:size, size:].T
        return out * self.scale

    def _of_band(self, a: int, b: int) -> Floats:
        """Rows and columns `a` to `b` of the inverse Z of the band L L', T being the band's width of rows after them.

        Z_SS = (L_SS L_SS')^-1 + U Z_TT U', U = L_SS'^-1 L_TS' = (L_SS L_SS')^-1 L_SS L_TS'; Z_TT lies within its band.
        """
        lower, (width, n) = self.factor.band[:, a:b], (self.factor.band.shape[0] - 1, self.factor.band.shape[1])
        size, after = b - a, min(width, n - b)
        if size <= width + 1:
            apart, least = _offsets(size)
            return np.asarray(self._band[apart, a + least])
        out: Floats = cho_solve_banded((lower, True), np.eye(size), check_finite=False)
        if after:
            tail = min(width, size)
            whole = np.zeros((tail + after, tail))  # the last rows and columns of L_SS, and L_TS below
            for d in range(min(width, tail + after - 1) + 1):
                columns = np.arange(min(tail, tail + after - d))
                whole[columns + d, columns] = lower[d, size - tail + columns]
            coupled = np.zeros((size, after))
            coupled[size - tail :] = whole[:tail] @ whole[tail:].T
            coupled = cho_solve_banded((lower, True), coupled, check_finite=False)
            i = np.arange(after)
            out += coupled @ self._band[np.abs(i[:, None] - i), b + np.minimum(i[:, None], i)] @ coupled.T
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Sandwich:
    """V = N^-1 M N^-1, as far as `pairs` asks for it.

    With K, B, C the parts of N, E = K^-1 B, S = C - B'E and F' = (-E', 1), N^-1 is K^-1 and F S^-1 F' on top, so that

        V = K^-1 M K^-1 + [K^-1 M F S^-1 F'] + [...]' + F S^-1 (F'M F) S^-1 F'

    of which a band and what concerns the border is kept: memory linear in time.

    band     (w + 1, n) of K^-1 M K^-1
    half     (n, q) K^-1 M F S^-1
    corner   (q, q) S^-1 F'M F S^-1
    eliminated (n, q) E
    """

    band: Floats
    half: Floats
    corner: Floats
    eliminated: Floats

    @cached_property
    def _spread(self) -> Floats:
        return np.asarray(self.eliminated @ self.corner)

    def pairs(self, i: Ints, j: Ints) -> Floats:
        """See `Covariance`."""
        i, j = np.broadcast_arrays(i, j)
        n, out = self.band.shape[1], np.zeros(i.shape)
        low, high = np.minimum(i, j), np.maximum(i, j)
        both, corner = high < n, low >= n
        if both.any():
            a, b = low[both], high[both]
            E, half = self.eliminated, self.half
            coupled = ((self._spread[a] - half[a]) * E[b]).sum(-1) - (E[a] * half[b]).sum(-1)
            out[both] = self.band[b - a, a] + coupled
        mixed = ~both & ~corner
        out[mixed] = (self.half - self._spread)[low[mixed], high[mixed] - n]
        out[corner] = self.corner[i[corner] - n, j[corner] - n]
        return out


def motion_band(covariance: Covariance, model: Model, target: int) -> Floats:
    """(count, degree + 1, 3, 3) of one target's coefficients, as `Motion` holds it."""
    basis = model.basis.targets[target]
    place = model.order.coefficient[basis.first : basis.first + basis.count]
    out = np.zeros((basis.count, basis.degree + 1, 3, 3))
    for d in range(min(basis.degree + 1, basis.count)):
        a = np.arange(basis.count - d)
        for axis in range(3):
            out[a, d, axis] = covariance.pairs(place[a, axis, None], place[a + d])
    return out


@lru_cache(maxsize=256)
def _offsets(size: int) -> tuple[Ints, Ints]:
    """How far apart rows and columns of a square are, and which is the lesser."""
    i = np.arange(size)
    return np.abs(i[:, None] - i), np.minimum(i[:, None], i)


@lru_cache(maxsize=256)
def _lower_half(size: int) -> tuple[Ints, Ints]:
    i, j = np.tril_indices(size)
    return np.asarray(i), np.asarray(j)


@dataclass(eq=False)
class _Meat:
    """M as it grows: band (w + 1, n) in lower form, as wide as it has to be, border (n, q), corner (q, q)."""

    band: Floats
    border: Floats
    corner: Floats

    def system(self) -> Bordered:
        """The matrix, to multiply with."""
        return Bordered(
            band=self.band, border=self.border, corner=self.corner, gradient=np.zeros(sum(self.border.shape))
        )

    def add(self, rows: Ints, matrix: Floats) -> None:
        """Adds a symmetric matrix at the unknowns `rows`, those of the band first and in order."""
        n = self.band.shape[1]
        k = int(np.searchsorted(rows, n))
        top, low = rows[:k], rows[k:] - n
        if k:
            self._widen(int(top[-1] - top[0]) + 1)
            i, j = _lower_half(k)
            self.band[top[i] - top[j], top[j]] += matrix[i, j]
            self.border[top[:, None], low] += matrix[:k, k:]
        self.corner[low[:, None], low] += matrix[k:, k:]

    def _widen(self, rows: int) -> None:
        if rows > len(self.band):
            more = np.zeros((rows - len(self.band), self.band.shape[1]))
            self.band = np.concatenate([self.band, more])


def _add_priors(model: Model, state: State, meat: _Meat) -> None:
    """Adds the information of the priors: what they let vary is as large as they say."""
    order, priors = model.order, model.priors
    known = (order.camera >= 0) & (priors.camera_precision > 0)
    at = order.camera[known] - order.n_band
    meat.corner[at, at] += priors.camera_precision[known]
    for c in range(len(model.frames.cameras)):
        own = model.drift.of(c)
        if model.drift_free and own.stop > own.start:
            meat.add(order.drift[own], drift_penalty(model.drift, c, float(priors.drift_rate[c])))
    if model.wander is not None:
        for c, axis, matrix in model.wander.penalties:
            meat.add(order.wander[model.wander.of(c), axis], matrix)
    for n, target in enumerate(model.basis.targets):
        if target.kind == "spline":
            first, rows, _ = jerk_penalty(model, n)
            acting = order.coefficient[first[:, None] + np.arange(rows.shape[1])]
            i, j = np.tril_indices(rows.shape[1])
            for axis in range(3):
                place = acting[..., axis]
                np.add.at(meat.band, (place[:, i] - place[:, j], place[:, j]), rows[:, i, axis] * rows[:, j, axis])
    add_known(model, state, meat.band, meat.border, meat.corner)


def sandwich(model: Model, state: State, plain: Inverse, system: Bordered, cluster: Ints) -> Sandwich:
    """The cluster-robust covariance; `cluster` (F,) says which frames' errors belong together.

    `system` are the normal equations with their priors, `plain` their inverse.
    """
    n, q = system.border.shape
    meat = _Meat(band=np.zeros_like(system.band), border=np.zeros((n, q)), corner=np.zeros((q, q)))
    for _, rows, gradient in freed(model, state, plain.block, cluster):
        meat.add(rows, np.multiply.outer(gradient, gradient))
    _add_priors(model, state, meat)
    E, whole = plain.factor.eliminated, meat.system()
    through = whole.times(np.concatenate([-E, np.eye(q)]))  # M F
    inner = through[n:] - E.T @ through[:n]  # F'M F
    S = plain.corner
    half = cho_solve_banded((plain.factor.band, True), through[:n], check_finite=False) @ S if n else through[:0]
    band = band_of_sandwich(system.band, meat.band) if n else meat.band
    return Sandwich(band=band, half=half, corner=S @ inner @ S, eliminated=E)
