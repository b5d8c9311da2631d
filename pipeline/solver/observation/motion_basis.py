"""Motion of all targets in one form: inside a span of common time every target is a short power series.

In span s, with u = (t - mid_s) / half_s in [-1, 1], target n is X_n = sum_j u^j m_j and m = transform[s] c, where c are
the few of the target's coefficients that act there. A polynomial has one span, the whole flight, and its coefficients
are the power series itself; a cubic spline has a span between every two knots. The solver's inner loops only ever see
power series, whatever the motion is. Beside splines a polynomial's series in a span ends where more of it is nothing:
with h the span's share of the whole, interpolating v^p at Chebyshev points by degree K misses less than
binomial(p, K + 1) h^(K + 1) / 2^K (Trefethen, Approximation Theory and Approximation Practice, 2013, chapter 8).

The motion prior of a spline is white jerk: the integral of |X'''|^2 / q^2 dt, exact since X''' is constant in a span.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry.splines import acting
from pipeline.records import Motion
from pipeline.records.motion import MotionKind

SPLINE_DEGREE = 3
NOTHING = 1e-7
"""Of a polynomial's coefficient, what its series in a span may miss: 10 micrometres of 100 m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetBasis:
    """How one target's coefficients act.

    degree     of the polynomial, or of the spline
    knots_s    clamped knots of a spline; the two ends for a polynomial
    first      of its coefficients among all targets' coefficients; `count` of them
    active     (S,) first coefficient (among all) that acts in each span; degree + 1 do
    transform  (S, K + 1, degree + 1), K the degree of the series in the spans
    """

    target: str
    kind: MotionKind
    degree: int
    knots_s: Floats
    first: int
    count: int
    active: Ints
    transform: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionBasis:
    """Spans `grid_s` (S + 1,) of common time, and every target's place in them; `degree` is that of the series."""

    grid_s: Floats
    degree: int
    targets: tuple[TargetBasis, ...]

    @cached_property
    def transforms(self) -> Floats:
        """(S, N, K + 1, A) of all targets, zero in the columns that a target with fewer than A coefficients lacks."""
        out = np.zeros((len(self.grid_s) - 1, len(self.targets), self.degree + 1, self.most_acting))
        for n, t in enumerate(self.targets):
            out[:, n, :, : t.degree + 1] = t.transform
        return out

    @cached_property
    def degrees(self) -> Ints:
        """(N,) of the targets."""
        return np.array([t.degree for t in self.targets], dtype=np.int64)

    @cached_property
    def firsts(self) -> Ints:
        """(N,) first coefficients of the targets."""
        return np.array([t.first for t in self.targets], dtype=np.int64)

    @property
    def most_acting(self) -> int:
        """Coefficients of one target that act in one span, at most."""
        return 1 + max(t.degree for t in self.targets)

    @property
    def count(self) -> int:
        """Coefficients of all targets (each is a 3-vector)."""
        return sum(t.count for t in self.targets)

    @property
    def mid_s(self) -> Floats:
        """(S,) middle of the spans."""
        return np.asarray(0.5 * (self.grid_s[1:] + self.grid_s[:-1]))

    @property
    def half_s(self) -> Floats:
        """(S,) half their length."""
        return np.asarray(0.5 * (self.grid_s[1:] - self.grid_s[:-1]))

    def span(self, time_s: Floats) -> Ints:
        """Span (n,) of common times (n,); the first and last reach to infinity."""
        if len(self.grid_s) == 2:
            return np.zeros(len(time_s), dtype=np.int64)
        return np.clip(np.searchsorted(self.grid_s, time_s, side="right") - 1, 0, len(self.grid_s) - 2)

    def series(self, span: Ints, coefficients: Floats) -> Floats:
        """Power series (n, N, 3, K + 1) of all targets in spans (n,)."""
        out = np.empty((len(span), len(self.targets), 3, self.degree + 1))
        for n, t in enumerate(self.targets):
            acting = coefficients[t.active[span][:, None] + np.arange(t.degree + 1)]
            out[:, n] = np.swapaxes(t.transform[span] @ acting, 1, 2)
        return out

    def position(self, time_s: Floats, coefficients: Floats) -> Floats:
        """Positions (n, N, 3) at common times (n,)."""
        span = self.span(time_s)
        u = (time_s - self.mid_s[span]) / self.half_s[span]
        powers = u[:, None] ** np.arange(self.degree + 1)
        return np.asarray(np.einsum("bnij,bj->bni", self.series(span, coefficients), powers))


def _nodes(degree: int) -> Floats:
    """degree + 1 Chebyshev points of [-1, 1]."""
    return np.asarray(np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)))


def _spline_transform(grid: Floats, knots: Floats, interval: Ints, greatest: int) -> Floats:
    """(S, greatest + 1, 4) from the acting B-spline coefficients to the span's power series."""
    u = _nodes(greatest)
    time = 0.5 * (grid[1:] + grid[:-1])[:, None] + 0.5 * np.diff(grid)[:, None] * u
    values = acting(knots, SPLINE_DEGREE, np.broadcast_to(interval[:, None], time.shape), time)
    return np.asarray(np.linalg.solve(np.vander(u, greatest + 1, increasing=True), values))


def _polynomial_transform(grid: Floats, start: float, end: float, order: int, greatest: int) -> Floats:
    """(S, greatest + 1, order + 1) from powers of (t - middle) / half length of the whole to the span's series."""
    if len(grid) == 2 and grid[0] == start and grid[1] == end:
        return np.eye(greatest + 1, order + 1)[None]
    u = _nodes(greatest)
    time = 0.5 * (grid[1:] + grid[:-1])[:, None] + 0.5 * np.diff(grid)[:, None] * u
    v = (2 * time - start - end) / (end - start)
    values = v[..., None] ** np.arange(order + 1)
    return np.asarray(np.linalg.solve(np.vander(u, greatest + 1, increasing=True), values))


def build_basis(
    names: tuple[str, ...], kinds: tuple[MotionKind, ...], orders: tuple[int, ...], ends_s: Floats, spacing_s: float
) -> MotionBasis:
    """A basis over common times `ends_s` (N, 2), each target's own; splines share knots `spacing_s` apart."""
    ends = ends_s.tolist()
    start = min(low_s for low_s, _ in ends)
    end = max(*(high_s for _, high_s in ends), start + 1e-3)
    pieces = max(1, int(np.ceil((end - start) / spacing_s))) if "spline" in kinds else 1
    grid = np.linspace(start, end, pieces + 1) if pieces > 1 else np.array([start, end])
    degrees = [SPLINE_DEGREE if kind == "spline" else order for kind, order in zip(kinds, orders, strict=True)]
    greatest = max(_series_degree(degree, 1 / pieces) for degree in degrees)
    targets: list[TargetBasis] = []
    first, whole_s = 0, np.array([start, end])
    transforms = {k: _polynomial_transform(grid, start, end, k, greatest) for k in _polynomial_orders(kinds, orders)}
    for name, kind, order, (low_s, high_s) in zip(names, kinds, orders, ends, strict=True):
        if kind == "polynomial":
            target = TargetBasis(
                target=name, kind=kind, degree=order, knots_s=whole_s, first=first, count=order + 1,
                active=np.full(pieces, first, dtype=np.int64), transform=transforms[order],
            )  # fmt: skip
        else:
            target = _spline_target(name, grid, low_s, high_s, first, greatest)
        targets.append(target)
        first += target.count
    return MotionBasis(grid_s=grid, degree=greatest, targets=tuple(targets))


def _series_degree(order: int, share: float) -> int:
    """Degree of the series of a polynomial in spans that are a `share` of the whole; see the head."""
    for degree in range(SPLINE_DEGREE, order):
        if comb(order, degree + 1) * share ** (degree + 1) / 2**degree < NOTHING:
            return degree
    return order


def _polynomial_orders(kinds: tuple[MotionKind, ...], orders: tuple[int, ...]) -> set[int]:
    return {order for kind, order in zip(kinds, orders, strict=True) if kind == "polynomial"}


def _spline_target(name: str, grid: Floats, low_s: float, high_s: float, first: int, greatest: int) -> TargetBasis:
    """A cubic spline over the spans that touch [low_s, high_s]; beyond them its end pieces go on."""
    pieces, k = len(grid) - 1, SPLINE_DEGREE
    begin = int(np.clip(np.searchsorted(grid, low_s, side="right") - 1, 0, pieces - 1))
    stop = int(np.clip(np.searchsorted(grid, high_s, side="left"), begin + 1, pieces))
    inner = grid[begin : stop + 1]
    knots = np.concatenate([np.repeat(inner[0], k), inner, np.repeat(inner[-1], k)])
    own = np.clip(np.arange(pieces), begin, stop - 1) - begin
    return TargetBasis(
        target=name, kind="spline", degree=k, knots_s=knots, first=first, count=len(inner) - 1 + k,
        active=first + own, transform=_spline_transform(grid, knots, own + k, greatest),
    )  # fmt: skip


def jerk_rows(basis: MotionBasis, target: TargetBasis) -> tuple[Ints, Floats, Ints]:
    """Rows whose squares, summed over the target's spans, are the integral of |X'''|^2 dt.

    Returns the first acting coefficient (p,), the row (p, 4) and the span (p,), for the spans that its knots cover.
    """
    own = covered(basis, target)
    half = basis.half_s[own]
    row = target.transform[own, SPLINE_DEGREE, :] * (6 / half**3 * np.sqrt(2 * half))[:, None]
    return target.active[own], np.asarray(row), np.flatnonzero(own)


def covered(basis: MotionBasis, target: TargetBasis) -> Bools:
    """(S,) the spans that a target's knots cover; in the others its end pieces go on."""
    return np.asarray((basis.mid_s > target.knots_s[0]) & (basis.mid_s < target.knots_s[-1]))


def bernstein_from_powers(order: int) -> Floats:
    """(order + 1, order + 1): coefficients of the clamped spline without inner knots from powers of v in [-1, 1]."""
    v = _nodes(order)
    knots = np.concatenate([np.full(order + 1, -1.0), np.full(order + 1, 1.0)])
    values = acting(knots, order, np.full(len(v), order), v)
    return np.asarray(np.linalg.solve(values, np.vander(v, order + 1, increasing=True)))


def motion_of(target: TargetBasis, coefficients: Floats, band: Floats | None, start_s: float, end_s: float) -> Motion:
    """The record of one target, from its coefficients (count, 3) and their covariance (count, degree + 1, 3, 3)."""
    if target.kind == "spline":
        knots, c, covariance = target.knots_s, coefficients, band
    else:
        k = target.degree
        to = bernstein_from_powers(k)
        low, high = target.knots_s
        knots = np.concatenate([np.full(k + 1, low), np.full(k + 1, high)])
        c, covariance = to @ coefficients, None if band is None else _turned_band(to, band)
    return Motion(
        target=target.target, kind=target.kind, degree=target.degree, knots_s=knots, coefficients=c,
        covariance_band=covariance, start_s=start_s, end_s=end_s,
    )  # fmt: skip


def _turned_band(to: Floats, band: Floats) -> Floats:
    """The covariance band of `to` @ coefficients, where the band holds the whole covariance."""
    k = len(band)
    full = np.zeros((k, k, 3, 3))
    for i in range(k):
        for j in range(k - i):
            full[i, i + j] = band[i, j]
            full[i + j, i] = band[i, j].T
    turned = np.einsum("ai,ijxy,bj->abxy", to, full, to)
    out = np.zeros_like(band)
    for i in range(k):
        for j in range(k - i):
            out[i, j] = turned[i, i + j]
    return out
