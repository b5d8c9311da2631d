"""A symmetric positive definite system with a band and a border.

    [ K  B ] [x]     [f]      K (n, n) banded: spline coefficients in order of time
    [ B' C ] [y] = - [g]      C (q, q) dense: polynomials, cameras, clocks

K is factorised by banded Cholesky, y comes from the Schur complement C - B'K^-1B: cost linear in time. Nothing else is
ever formed; what is needed of the inverse is a band of its blocks, by the recursion of Takahashi.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.linalg.blas import dtrsm

from calibration.foundation.arrays import Floats
from pipeline.solver.adjustment import _band, _kernels

Complexes = npt.NDArray[np.complex128]
T = TypeVar("T", Floats, Complexes)
WIDE = 100_000
"""Width squared times right sides from which on dense blocks of a banded factor are quicker than its columns."""
COMPLEX_STEP = 1e-30
"""So short that its square is nothing beside one; no length of it is better than another."""


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

    def plus(self, other: Bordered) -> Bordered:
        """The sum of two systems of the same unknowns, in the memory of the wider one."""
        if len(self.band) < len(other.band):
            return other.plus(self)
        self.band[: len(other.band)] += other.band
        for mine, theirs in zip(
            (self.border, self.corner, self.gradient), (other.border, other.corner, other.gradient), strict=True
        ):
            mine += theirs
        return self

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
            eliminated = solve_banded(band, system.border)
        else:
            band, eliminated = system.band, system.border
        schur = system.corner - system.border.T @ eliminated
        corner = cho_factor(schur, lower=True, check_finite=False) if len(schur) else (schur, True)
    except LinAlgError:
        return None
    if not np.isfinite(corner[0]).all():
        return None
    return Factor(band=band, eliminated=eliminated, border=system.border, corner=corner)


def solve_banded(lower: Floats, right: Floats) -> Floats:
    """K^-1 times `right` (n, q) from the banded Cholesky factor `lower` (w + 1, n) of K.

    LAPACK's `pbtrs` takes one right side after the other; many at once are taken by blocks as wide as the band.
    """
    width, n = len(lower) - 1, lower.shape[1]
    if width * width * right.shape[1] < WIDE:
        return np.asarray(cho_solve_banded((lower, True), right, check_finite=False))
    out = np.array(right, order="C")
    begins = range(0, n, width)
    for begin in begins:
        own = out[begin : begin + width]
        if begin:
            own -= _below(lower, begin - width) @ out[begin - width : begin]
        own[:] = dtrsm(1.0, _upper(lower, begin), own.T, side=1, overwrite_b=1).T
    for begin in reversed(begins):
        own, after = out[begin : begin + width], out[begin + width : begin + 2 * width]
        if len(after):
            own -= _below(lower, begin).T @ after
        own[:] = dtrsm(1.0, _upper(lower, begin), own.T, side=1, trans_a=1, overwrite_b=1).T
    return out


def _upper(lower: Floats, begin: int) -> Floats:
    """(s, s) transpose of the factor's diagonal block of the band's width from `begin` on."""
    size = min(len(lower) - 1, lower.shape[1] - begin)
    apart, least = np.subtract.outer(np.arange(size), np.arange(size)), np.arange(size)
    return np.asarray(np.where(apart >= 0, lower[np.maximum(apart, 0), begin + least], 0.0).T)


def _below(lower: Floats, begin: int) -> Floats:
    """(s, w) block of the factor below its diagonal block from `begin` on."""
    width = len(lower) - 1
    size = min(width, lower.shape[1] - begin - width)
    apart = width + np.subtract.outer(np.arange(size), np.arange(width))
    return np.where(apart <= width, lower[np.minimum(apart, width), begin + np.arange(width)], 0.0)


def band_of_inverse(lower: T) -> T:
    """`band_of_inverse_plain`, compiled where it can be and numbers are real."""
    if lower.dtype == complex or not _kernels.AVAILABLE:
        return band_of_inverse_plain(lower)
    return np.asarray(np.ascontiguousarray(_band.inverse_band(np.ascontiguousarray(lower)).T))


def band_of_inverse_plain(lower: T) -> T:
    """Band (w + 1, n) of K^-1, lower form, from the banded Cholesky factor `lower` of K (Takahashi's recursion).

    With K = L D L', K^-1 = D^-1 L^-1 + (I - L') K^-1, so column j of the band follows from the columns after it.
    """
    width, n = lower.shape[0] - 1, lower.shape[1]
    out = np.zeros_like(lower)
    unit = lower[1:] / lower[0]
    window = np.zeros((width, width), dtype=lower.dtype)
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


def _complex_cholesky(band: Complexes) -> Complexes:
    """L (w + 1, n), lower form, with L L' = K; no conjugate is taken, the imaginary part being a direction."""
    width, n = band.shape[0] - 1, band.shape[1]
    out = np.zeros_like(band)
    padded = np.zeros((width + 1, n + width + 1), dtype=complex)
    padded[:, :n], padded[0, n:] = band, 1.0
    offset = np.arange(width + 1)
    high, low = np.maximum(offset[:, None], offset), np.minimum(offset[:, None], offset)
    window = padded[high - low, low]
    for j in range(n):
        column = window[:, 0] / np.sqrt(window[0, 0])
        out[:, j] = column
        window[:-1, :-1] = window[1:, 1:] - np.multiply.outer(column[1:], column[1:])
        window[-1] = window[:, -1] = padded[width - offset, j + 1 + offset]
    return out


def band_of_sandwich(band: Floats, meat: Floats) -> Floats:
    """Band (w + 1, n), w the wider one's, of K^-1 M K^-1 from the bands of K and M, in memory linear in n.

    It is minus the derivative of (K + h M)^-1 by h, taken by a complex step (Squire and Trapp, SIAM Review 40, 1998):
    exact, since nothing is subtracted.
    """
    width = max(len(band), len(meat))
    both = np.zeros((width, band.shape[1]), dtype=complex)
    both[: len(band)] = band
    both[: len(meat)] += 1j * COMPLEX_STEP * meat
    return np.asarray(-band_of_inverse(_complex_cholesky(both)).imag / COMPLEX_STEP)
