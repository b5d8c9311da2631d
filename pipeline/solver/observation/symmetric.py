"""Symmetric systems that may be singular: an answer where there is one, the shortest where there are many, else NaN."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats

LEAST = 1e-13
"""Share of the greatest eigenvalue, rows and columns scaled to one, below which a direction is not determined."""


def solved(matrix: Floats, right: Floats) -> Floats:
    """x (..., n, k) of `matrix` (..., n, n) x = `right` (..., n, k)."""
    scale = 1 / np.sqrt(np.maximum(np.abs(np.diagonal(matrix, axis1=-2, axis2=-1)), 1e-300))
    whole = matrix * scale[..., :, None] * scale[..., None, :]
    wanted = right * scale[..., None]
    try:
        out = np.linalg.solve(whole, wanted)
        if np.isfinite(out).all():
            return np.asarray(out * scale[..., None])
    except np.linalg.LinAlgError:
        pass
    try:
        out = np.linalg.pinv(whole, rcond=LEAST, hermitian=True) @ wanted
    except np.linalg.LinAlgError:
        out = np.full(wanted.shape, np.nan)
    return np.asarray(out * scale[..., None])
