"""A symmetric positive definite system with a band and a border.

    [ K  B ] [x]     [f]      K (n, n) banded: spline coefficients in order of time
    [ B' C ] [y] = - [g]      C (q, q) dense: polynomials, cameras, clocks

K is factorised by banded Cholesky, y comes from the Schur complement C - B'K^-1B: cost linear in time. Nothing else is
ever formed; what is needed of the inverse is a band of its blocks, by the recursion of Takahashi.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from calibration.foundation.arrays import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Bordered:
    """`band` (w + 1, n) lower form, band[i - j, j] = K[i, j]; `border` (n, q); `corner` (q, q); `gradient` (n + q,)."""

    band: Floats
    border: Floats
    corner: Floats
    gradient: Floats

    @property
    def n_band(self) -> int:
        """Unknowns of the band."""
        return int(self.band.shape[1])

    @property
    def diagonal(self) -> Floats:
        """(n + q,)."""
        return np.concatenate([self.band[0], np.diagonal(self.corner)])

    def times(self, x: Floats) -> Floats:
        """The matrix times x (n + q,) or (n + q, k)."""
        n = self.n_band
        top, low = x[:n], x[n:]
        out = np.concatenate([self.border @ low, self.border.T @ top + self.corner @ low])
        columns = self.band.shape[0] if n else 0
        shape = (-1,) + (1,) * (x.ndim - 1)
        for d in range(min(columns, n)):
            off = self.band[d, : n - d].reshape(shape)
            out[d:n] += off * top[: n - d]
            if d:
                out[: n - d] += off * top[d:]
        return out

    def scaled(self, scale: Floats) -> Bordered:
        """The same in other units: row and column i times scale[i]."""
        n = self.n_band
        top, low = scale[:n], scale[n:]
        band = self.band * top
        for d in range(min(self.band.shape[0], n)):
            band[d, : n - d] *= top[d:]
        return Bordered(
            band=band, border=top[:, None] * self.border * low, corner=low[:, None] * self.corner * low,
            gradient=scale * self.gradient,
        )  # fmt: skip

    def damped(self, amount: Floats) -> Bordered:
        """The same with `amount` (n + q,) added to the diagonal."""
        n = self.n_band
        band, corner = self.band.copy(), self.corner.copy()
        if n:
            band[0] += amount[:n]
        corner[np.diag_indices_from(corner)] += amount[n:]
        return replace(self, band=band, corner=corner)


@dataclass(frozen=True, kw_only=True, eq=False)
class Factor:
    """Factors of a Bordered: banded Cholesky of K, K^-1 B, and Cholesky of the Schur complement."""

    band: Floats
    eliminated: Floats
    border: Floats
    corner: tuple[Floats, bool]

    def solve(self, right: Floats) -> Floats:
        """The inverse times `right` (n + q,) or (n + q, k)."""
        n = self.band.shape[1]
        low = right[n:] - self.eliminated.T @ right[:n]
        y = cho_solve(self.corner, low, check_finite=False) if len(low) else low
        if not n:
            return np.asarray(y)
        x = cho_solve_banded((self.band, True), right[:n], check_finite=False) - self.eliminated @ y
        return np.concatenate([x, y])

    def corner_covariance(self) -> Floats:
        """(q, q) block of the inverse."""
        q = len(self.corner[0])
        return np.asarray(cho_solve(self.corner, np.eye(q))) if q else np.empty((0, 0))

    def smallest_pivot(self) -> float:
        """Smallest squared pivot: about how near to singular the matrix was."""
        pivots = np.concatenate([self.band[0], np.diagonal(self.corner[0])])
        return float(pivots.min(initial=np.inf)) ** 2

    def log_determinant(self) -> float:
        """Of the whole matrix."""
        inner = float(np.log(np.diagonal(self.corner[0])).sum())
        return 2 * (inner + float(np.log(self.band[0]).sum()) if self.band.shape[1] else inner)


def factorise(system: Bordered) -> Factor | None:
    """Factors, or None where the matrix is not positive definite."""
    try:
        if system.n_band:
            band = cholesky_banded(system.band, lower=True, check_finite=False)
            eliminated = cho_solve_banded((band, True), system.border, check_finite=False)
        else:
            band, eliminated = system.band, system.border
        schur = system.corner - system.border.T @ eliminated
        corner = cho_factor(schur, lower=True, check_finite=False) if len(schur) else (schur, True)
    except LinAlgError:
        return None
    if not np.isfinite(corner[0]).all():
        return None
    return Factor(band=band, eliminated=eliminated, border=system.border, corner=corner)


def band_of_inverse(lower: Floats) -> Floats:
    """Band (w + 1, n) of K^-1, lower form, from the banded Cholesky factor `lower` of K (Takahashi's recursion).

    With K = L D L', K^-1 = D^-1 L^-1 + (I - L') K^-1, so column j of the band follows from the columns after it.
    """
    width, n = lower.shape[0] - 1, lower.shape[1]
    out = np.zeros((width + 1, n))
    unit = lower[1:] / lower[0]
    window = np.zeros((width, width))
    for j in range(n - 1, -1, -1):
        m = min(width, n - 1 - j)
        below = unit[:m, j]
        column = -window[:m, :m] @ below
        diagonal = 1 / lower[0, j] ** 2 - below @ column
        out[0, j], out[1 : m + 1, j] = diagonal, column
        window[1:, 1:] = window[:-1, :-1].copy()
        if width:
            window[0, 0] = diagonal
            keep = min(m, width - 1)
            window[0, 1 : keep + 1] = window[1 : keep + 1, 0] = column[:keep]
    return out
