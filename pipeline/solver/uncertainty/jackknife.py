"""What a cluster of sightings would say of itself, had it not taken part: its gradient, freed of its own leverage.

Residuals are smaller than the errors they come from, because the adjustment follows them; most where a cluster alone
says something. With N the normal matrix, N_c a cluster's share of it and g its gradient at the optimum, the optimum
without it lies (N - N_c)^-1 g away, which is N^-1 (I - N_c N^-1)^-1 g: the jackknife, or CR3 of cluster-robust
covariances (Bell and McCaffrey, Survey Methodology 28, 2002).

N_c touches only what acts while the cluster lasts, so that block of N^-1 is all that is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.adjustment.assembly import blocks_at
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.adjustment.seen_targets import seen_targets

MOST_LEVERAGE = 0.95
"""Where a cluster alone decides, its residuals say nothing of its errors; no gradient grows by more than 20."""

CHUNK_BLOCKS = 1024
"""Blocks whose normal equations are held at once."""


def freed_gradients(model: Model, state: State, block: Callable[[int, int, Ints], Floats], cluster: Ints) -> Floats:
    """(n + q, M) the gradient of every cluster's frames freed of its leverage; `cluster` (F,) counts from 0.

    `block` gives blocks of the inverse of the normal matrix, priors and all: `Inverse.block`.
    """
    out = np.zeros((model.order.n_band + model.order.n_border, int(cluster.max()) + 1))
    for c, rows, gradient in freed(model, state, block, cluster):
        out[rows, c] = gradient
    return out


def freed(
    model: Model, state: State, block: Callable[[int, int, Ints], Floats], cluster: Ints
) -> Iterator[tuple[int, Ints, Floats]]:
    """Of every cluster its number, the unknowns that act while it lasts, and its gradient by them, freed of leverage.

    Its unknowns of the band lie side by side and come first. Memory is bounded: some blocks are done at a time.
    """
    seen = seen_targets(model, *blocks_at(model, state, cluster))
    begin = np.searchsorted(seen.blocks.cluster, np.arange(int(cluster.max()) + 2))
    n, low = model.order.n_band, 0
    chunk = seen.at_once(CHUNK_BLOCKS)
    while low < len(begin) - 1:
        high = max(low + 1, int(np.searchsorted(begin, begin[low] + chunk, side="right")) - 1)
        part = seen.part(int(begin[low]), int(begin[high]))
        normals, chain = part.normals(model), part.chain()
        turned = np.swapaxes(chain, 1, 2)
        share, vector = turned @ normals.normal @ chain, (turned @ normals.gradient[..., None])[..., 0]
        for c in range(low, high):
            own = slice(int(begin[c] - begin[low]), int(begin[c + 1] - begin[low]))
            found = _freed(n, part.places[own], share[own], vector[own], block)
            if found is not None:
                yield c, *found
        low = high


def _freed(
    n: int, place: Ints, share: Floats, vector: Floats, block: Callable[[int, int, Ints], Floats]
) -> tuple[Ints, Floats] | None:
    """Of a cluster of k blocks: its unknowns and its gradient by them, freed; None where nothing is free.

    place (k, G) of the blocks' unknowns, of which `n` are in the band; share (k, G, G) and vector (k, G): normals
    """
    acting = np.unique(place[place >= 0])
    if not len(acting):
        return None
    a, b = (int(acting[0]), int(acting[np.searchsorted(acting, n) - 1]) + 1) if acting[0] < n else (n, n)
    rows = np.concatenate([np.arange(a, b), acting[acting >= n]])
    size = len(rows)
    at = np.where(place >= 0, np.searchsorted(rows, place), size)
    information, gradient = np.zeros((size + 1, size + 1)), np.zeros(size + 1)
    for k in range(len(place)):
        information[at[k][:, None], at[k]] += share[k]
        gradient[at[k]] += vector[k]
    left = -MOST_LEVERAGE * information[:size, :size] @ block(a, b, rows[b - a :] - n)
    left[np.arange(size), np.arange(size)] += 1.0
    return np.asarray(rows), np.asarray(np.linalg.solve(left, gradient[:size]))
