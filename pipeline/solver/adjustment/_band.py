"""Compiled twin of `banded_system.band_of_inverse_plain`, for real numbers."""

# As in `_lanes`: spelt out, because that is what makes it fast.
from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Floats2
from calibration.foundation.compiled import compiled


@compiled
def inverse_band(lower: Floats2) -> Floats:
    """Band of K^-1 by columns (n, w + 1) from the banded Cholesky factor `lower` (w + 1, n) of K."""
    width, n = lower.shape[0] - 1, lower.shape[1]
    out = np.zeros((n, width + 1))
    below, column = np.zeros(width + 1), np.zeros(width + 1)
    for step in range(n):
        j = n - 1 - step
        m = min(width, step)
        inverse = 1.0 / lower[0, j]
        for i in range(1, m + 1):
            below[i] = lower[i, j] * inverse
            column[i] = 0.0
        for k in range(1, m + 1):
            known, under, into = out[j + k], below[k:], column[k:]
            of_k, s = below[k], 0.0
            for e in range(m - k + 1):
                s += known[e] * under[e]
            for e in range(1, m - k + 1):
                into[e] -= known[e] * of_k
            column[k] -= s
        diagonal = inverse * inverse
        for i in range(1, m + 1):
            diagonal -= below[i] * column[i]
            out[j, i] = column[i]
        out[j, 0] = diagonal
    return out
