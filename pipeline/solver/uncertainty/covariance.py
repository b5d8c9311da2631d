"""Uncertainty of everything from the factors of the normal equations.

Plain: the inverse of the normal matrix N, of which only a band of blocks and the cameras' block are formed.
Robust (sandwich): N^-1 (sum over clusters of g g' + priors) N^-1, g a cluster's gradient without its own leverage
(`jackknife.py`). Errors of a tracker are alike from frame to frame, so that a cluster's frames (a camera, a stretch
of time) count as one observation of what they have in common; the plain covariance would take them for many.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import cho_solve_banded

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.banded_system import Factor, band_of_inverse
from pipeline.solver.adjustment.model import Model, State, drift_penalty, jerk_penalty
from pipeline.solver.observation.pose_wander import wander_penalty
from pipeline.solver.uncertainty.jackknife import freed_gradients

EXACT_ROWS = 400
"""Prior rows up to which their part of the sandwich is exact; beyond, that many random sums of them stand for them."""


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
        out[size:, size:] = self.corner[np.ix_(border, border)]
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
    """A covariance as the product of `columns` (n + q, m) with their own transpose."""

    columns: Floats

    def pairs(self, i: Ints, j: Ints) -> Floats:
        """See `Covariance`."""
        return np.asarray(np.einsum("...m,...m->...", self.columns[i], self.columns[j], optimize=False))


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


def prior_rows(model: Model) -> Floats:
    """(n + q, R): columns whose products sum to the information of the priors, or to it on average."""
    order, priors = model.order, model.priors
    size = order.n_band + order.n_border
    known = (order.camera >= 0) & (priors.camera_precision > 0)
    parts = [np.zeros((size, int(known.sum())))]
    parts[0][order.camera[known], np.arange(known.sum())] = np.sqrt(priors.camera_precision[known])
    for c in range(len(model.frames.cameras)):
        own = model.drift.of(c)
        if model.drift_free and own.stop > own.start:
            rows = np.zeros((size, own.stop - own.start))
            rows[order.drift[own]] = np.linalg.cholesky(drift_penalty(model.drift, c, float(priors.drift_rate[c])))
            parts.append(rows)
    parts += _wander_columns(model, size)
    rng = np.random.default_rng(0)
    for n, target in enumerate(model.basis.targets):
        if target.kind == "spline":
            parts.append(_jerk_columns(model, n, size, rng))
    return np.concatenate(parts, axis=1)


def _wander_columns(model: Model, size: int) -> list[Floats]:
    """The Gauss-Markov priors of wandering poses."""
    out: list[Floats] = []
    wander = model.wander
    for c in range(len(model.frames.cameras)):
        own = slice(0, 0) if wander is None else wander.of(c)
        for axis in range(6):
            if wander is not None and own.stop > own.start and wander.sigma[c, axis] > 0:
                rows = np.zeros((size, own.stop - own.start))
                rows[model.order.wander[own, axis]] = np.linalg.cholesky(wander_penalty(wander, c, axis))
                out.append(rows)
    return out


def _jerk_columns(model: Model, n: int, size: int, rng: np.random.Generator) -> Floats:
    """The white-jerk rows of one spline, all three axes; random sums of them where there are many."""
    first, rows, _ = jerk_penalty(model, n)
    acting = model.order.coefficient[first[:, None] + np.arange(rows.shape[1])]
    spans = len(first)
    exact = 3 * spans <= EXACT_ROWS
    out = np.zeros((size, 3 * spans if exact else EXACT_ROWS))
    for axis in range(3):
        for a in range(rows.shape[1]):
            if exact:
                out[acting[:, a, axis], 3 * np.arange(spans) + axis] += rows[:, a]
            else:
                if a == 0:
                    signs = rng.choice([-1.0, 1.0], size=(spans, EXACT_ROWS)) / np.sqrt(EXACT_ROWS)
                np.add.at(out, acting[:, a, axis], rows[:, a, None] * signs)
    return out


def sandwich(model: Model, state: State, plain: Inverse, cluster: Ints) -> Sandwich:
    """The cluster-robust covariance; `cluster` (F,) says which frames' errors belong together."""
    meat = np.concatenate([freed_gradients(model, state, plain.block, cluster), prior_rows(model)], axis=1)
    return Sandwich(columns=plain.factor.solve(meat))
