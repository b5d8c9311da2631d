"""What a cluster of sightings would say of itself, had it not taken part: its gradient, freed of its own leverage.

Residuals are smaller than the errors they come from, because the adjustment follows them; most where a cluster alone
says something. With N the normal matrix, N_c a cluster's share of it and g its gradient at the optimum, the optimum
without it lies (N - N_c)^-1 g away, which is N^-1 (I - N_c N^-1)^-1 g: the jackknife, or CR3 of cluster-robust
covariances (Bell and McCaffrey, Survey Methodology 28, 2002).

N_c touches only what acts while the cluster lasts, so that block of N^-1 is all that is needed. With K = L L' the band,
S the cluster's rows, T the band's width after them and Z = K^-1,

    Z_SS = (L_SS L_SS')^-1 + U Z_TT U'        U = L_SS'^-1 L_TS' = (L_SS L_SS')^-1 L_SS L_TS'

and Z_TT lies within the band of the inverse.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve_banded

from calibration.arrays import Floats, Ints
from pipeline.solver.assembly import blocks_at, global_places, local_from_global
from pipeline.solver.bordered import Factor, band_of_inverse
from pipeline.solver.elimination import block_normals
from pipeline.solver.model import Model, State

MOST_LEVERAGE = 0.95
"""Where a cluster alone decides, its residuals say nothing of its errors; no gradient grows by more than 20."""


def freed_gradients(model: Model, state: State, factor: Factor, cluster: Ints) -> Floats:
    """(n + q, M) the gradient of every cluster's frames freed of its leverage; `cluster` (F,) counts from 0.

    `factor` is of the normal equations with all priors.
    """
    blocks, at = blocks_at(model, state, cluster)
    normals = block_normals(model.frames, model.pose, model.loss, at, blocks)
    places = global_places(model, blocks)
    n, count = model.order.n_band, int(cluster.max()) + 1
    inverse = _InverseBlocks(factor)
    out = np.zeros((n + model.order.n_border, count))
    begin = np.searchsorted(blocks.cluster, np.arange(count + 1))
    for c in range(count):
        low, high = int(begin[c]), int(begin[c + 1])
        if low == high:
            continue
        chain = local_from_global(model, blocks, low, high)
        turned = np.swapaxes(chain, 1, 2)
        share, vector = turned @ normals.normal[low:high] @ chain, turned @ normals.gradient[low:high, :, None]
        place = places[low:high]
        acting = np.unique(place[place >= 0])
        if not len(acting):
            continue
        a, b = (int(acting[0]), int(acting[acting < n].max(initial=-1)) + 1) if acting[0] < n else (n, n)
        rows = np.concatenate([np.arange(a, b), acting[acting >= n]])
        size = len(rows)
        own = np.where(place >= 0, np.searchsorted(rows, place), size)
        information, gradient = np.zeros((size + 1, size + 1)), np.zeros(size + 1)
        for k in range(high - low):
            information[own[k][:, None], own[k]] += share[k]
            gradient[own[k]] += vector[k, :, 0]
        left = np.eye(size) - MOST_LEVERAGE * information[:size, :size] @ inverse.of(a, b, rows[b - a :] - n)
        out[rows, c] = np.linalg.solve(left, gradient[:size])
    return out


class _InverseBlocks:
    """Blocks of the inverse of a factorised matrix: a stretch of the band with some of the border."""

    def __init__(self, factor: Factor) -> None:
        self.factor = factor
        self.band = band_of_inverse(factor.band) if factor.band.shape[1] else factor.band
        self.corner = factor.corner_covariance()
        self.spread = factor.eliminated @ self.corner

    def of(self, a: int, b: int, border: Ints) -> Floats:
        """(s, s) rows and columns `a` to `b` of the band, then those of the `border`."""
        size = b - a
        out = np.empty((size + len(border), size + len(border)))
        out[size:, size:] = self.corner[np.ix_(border, border)]
        if size:
            out[:size, :size] = self._of_band(a, b) + self.spread[a:b] @ self.factor.eliminated[a:b].T
            out[:size, size:] = -self.spread[a:b, border]
            out[size:, :size] = out[:size, size:].T
        return out

    def _of_band(self, a: int, b: int) -> Floats:
        """See the head of this file."""
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
            out += coupled @ self.band[np.abs(i[:, None] - i), b + np.minimum(i[:, None], i)] @ coupled.T
        return out
