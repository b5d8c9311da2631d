"""Judging clocks where every target moves as a polynomial: the motion is fitted, not interpolated.

Sighting i of target n by camera c, with world ray d, centre C, tangent basis T (3 x 2) of d, range r:

    e = T' (X_n(t_i) - C - p_c) / r - T' (R w_c x d),    X_n(t) = sum over k of a_nk u^k    (paper eq. 5 and 10)

e is an angle; w_c and p_c are the camera's constant rotation and shift with their priors. Given time and ranges this is
linear in everything (variable projection): the ranges come from the paper's eq. 8, then from the fit itself. The coarse
search solves it at every offset and a few rates, many at a time; `polynomial_polish` polishes what it finds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry.rotation import skew
from pipeline.solver.observation.observations import across
from pipeline.solver.observation.symmetric import solved
from pipeline.solver.offset_search.sweep import ClockGuess, ClockRange, SetCamera
from pipeline.solver.offset_search.views import Track, View, thinned

COARSE = 100
"""Sightings by one camera in the coarse search, all targets together; of each target at least twenty."""
BATCH = 64
"""Clocks that are tried at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Sightings of one target, all cameras together, of fixed geometry.

    camera   (m,) place in the list of views
    time_s   (m,) video time
    across   (m, 2, 3) T' over sigma
    turned   (m, 2, 3) T' [d]x R over sigma: what a rotation in camera axes does
    """

    order: int
    camera: Ints
    time_s: Floats
    centre_m: Floats
    ray: Floats
    across: Floats
    turned: Floats
    sigma_rad: Floats
    position_noise_m: Floats


def stacked_rows(views: Sequence[View], target: str, order: int, most: int = 40) -> Rows:
    """The sightings of one target by all `views`, at most `most` of each."""
    parts: list[tuple[int, View, Track]] = [
        (i, v, thinned(v.tracks[target], 0.0, most)) for i, v in enumerate(views) if target in v.tracks
    ]
    ray = np.concatenate([t.ray for _, _, t in parts])
    axes = np.concatenate([t.axes for _, _, t in parts])
    sigma = np.concatenate([np.hypot(t.pixel_rad, v.attitude_noise_rad) for _, v, t in parts])
    across_ray = across(ray) / sigma[:, None, None]
    return Rows(
        order=order,
        camera=np.concatenate([np.full(len(t), i) for i, _, t in parts]),
        time_s=np.concatenate([t.time_s for _, _, t in parts]),
        centre_m=np.concatenate([t.centre_m for _, _, t in parts]),
        ray=ray,
        across=across_ray,
        turned=across_ray @ skew(ray) @ axes,
        sigma_rad=sigma,
        position_noise_m=np.concatenate([np.full(len(t), v.position_noise_m) for _, v, t in parts]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Projected:
    """The best motion for each of g clocks: half chi-square (g,), coefficients (g, K + 1, 3) each, epoch, scale."""

    cost: Floats
    coefficients: list[Floats]
    bias: Floats
    epoch_s: Floats
    scale_s: Floats


def project_motion(views: Sequence[View], rows: Sequence[Rows], clocks: Floats, passes: int = 3) -> Projected:
    """Variable projection at clocks (g, c, 2) of offset and clock_scale."""
    times = [clocks[:, r.camera, 1] * r.time_s + clocks[:, r.camera, 0] for r in rows]
    low = np.min([t.min(axis=1) for t in times], axis=0)
    high = np.max([t.max(axis=1) for t in times], axis=0)
    epoch, scale = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-6)
    powers = [
        ((t - epoch[:, None]) / scale[:, None])[..., None] ** np.arange(r.order + 1)
        for t, r in zip(times, rows, strict=True)
    ]
    ranges = [np.ones_like(t) for t in times]
    found = _solved(views, rows, powers, ranges, biased=False)
    for _ in range(passes - 1):
        ranges = [_ranges(r, p, a)[0] for r, p, a in zip(rows, powers, found[1], strict=True)]
        found = _solved(views, rows, powers, ranges, biased=True)
    cost, coefficients, bias = found
    for r, p, a in zip(rows, powers, coefficients, strict=True):
        distance, behind = _ranges(r, p, a)
        cost = cost + (4.5 * behind + 2 * np.log(_spread(r, distance))).sum(axis=1)
    return Projected(cost=cost, coefficients=coefficients, bias=bias, epoch_s=epoch, scale_s=scale)


def _ranges(rows: Rows, powers: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """Distances (g, m) from camera to target, and where the target would be behind the camera."""
    away = powers @ coefficients - rows.centre_m
    ahead = (away * rows.ray).sum(-1)
    return np.maximum(np.linalg.norm(away, axis=-1), 0.1), ahead < 0


def _spread(rows: Rows, ranges: Floats) -> Floats:
    """How much wider (g, m) a residual is for the error of the camera's position; a near target is worth little."""
    return np.asarray(np.sqrt(1 + (rows.position_noise_m / (ranges * rows.sigma_rad)) ** 2))


def _solved(
    views: Sequence[View], rows: Sequence[Rows], powers: Sequence[Floats], ranges: Sequence[Floats], *, biased: bool
) -> tuple[Floats, list[Floats], Floats]:
    """Motions (g, K + 1, 3) per target, biases (g, 6 c) and half chi-square (g,) of the linear problem."""
    g, size = len(powers[0]), 6 * len(views)
    prior = np.concatenate([[v.attitude_bias_rad**-2] * 3 + [v.position_bias_m**-2] * 3 for v in views])
    schur = np.zeros((g, size, size)) + np.diag(prior)
    right, square, kept = np.zeros((g, size)), np.zeros(g), []
    for r, phi, distance in zip(rows, powers, ranges, strict=True):
        normal = _normal(r, phi, distance, size)
        n = 3 * (r.order + 1)
        motion = normal[:, :n, :n] + 1e-9 * np.trace(normal[:, :n, :n], axis1=1, axis2=2)[:, None, None] * np.eye(n) / n
        reduced = solved(motion, normal[:, :n, n:])
        rest = normal[:, n:, n:] - np.swapaxes(normal[:, :n, n:], 1, 2) @ reduced
        schur += rest[:, :size, :size]
        right += rest[:, :size, size]
        square += rest[:, size, size]
        kept.append(reduced)
    bias = solved(schur, right[..., None])[..., 0] if biased else np.zeros((g, size))
    cost: Floats = 0.5 * (square - (right * bias).sum(1))
    motions: list[Floats] = []
    for r, reduced in zip(rows, kept, strict=True):
        flat = reduced[:, :, size] - (reduced[:, :, :size] @ bias[..., None])[..., 0]
        motions.append(np.asarray(flat.reshape(g, r.order + 1, 3)))
    return np.asarray(cost), motions, np.asarray(bias)


def _normal(rows: Rows, powers: Floats, ranges: Floats, size: int) -> Floats:
    """Normal matrices (g, p, p) of [motion, biases, right-hand side] of one target."""
    g, m, terms = powers.shape
    spread = _spread(rows, ranges)
    scaled = rows.across / (ranges * spread)[..., None, None]
    design = np.zeros((g, m, 2, 3 * terms + size + 1))
    for k in range(terms):
        design[..., 3 * k : 3 * k + 3] = scaled * powers[:, :, k, None, None]
    for c in np.unique(rows.camera):
        mine = rows.camera == c
        at = 3 * terms + 6 * c
        design[:, mine, :, at : at + 3] = rows.turned[mine] / spread[:, mine, None, None]
        design[:, mine, :, at + 3 : at + 6] = -scaled[:, mine]
    design[..., -1] = (scaled @ rows.centre_m[:, :, None])[..., 0]
    flat = design.reshape(g, 2 * m, -1)
    return np.asarray(np.swapaxes(flat, 1, 2) @ flat)


def sweep_polynomial(
    new: View, placed: Sequence[SetCamera], allowed: ClockRange, keep: int, orders: Mapping[str, int]
) -> tuple[ClockGuess, ...]:
    """The best clocks of `new` against `placed` for targets of known polynomial order; local minima, best first."""
    views = [p.view for p in placed] + [new]
    wanted = [t for t in orders if any(t in v.tracks for v in views)]
    most = min(max(COARSE // max(len(wanted), 1), 20), 60)
    rows = [stacked_rows(views, t, orders[t], most) for t in wanted]
    first, last = new.span_s
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    step = float(np.clip(2 * half / 15, 0.1, 1.0))
    count = (
        int(np.ceil(allowed.clock_scale / min(0.05, 2 * step / half))) if allowed.clock_scale * half > step / 4 else 0
    )
    clock_scales = np.linspace(1 - allowed.clock_scale, 1 + allowed.clock_scale, 2 * count + 1) if count else np.ones(1)
    offsets = np.arange(allowed.low_s, allowed.high_s + step, min(step, (allowed.high_s - allowed.low_s) / 4))
    mid = offsets + middle
    grid = np.array([(t - s * middle, s) for t in mid for s in clock_scales])
    set_clocks = np.array([(p.offset_s, p.clock_scale) for p in placed])
    cost = []
    for i in range(0, len(grid), BATCH):
        part = grid[i : i + BATCH]
        clocks = np.concatenate([np.broadcast_to(set_clocks, (len(part), *set_clocks.shape)), part[:, None]], axis=1)
        cost.append(project_motion(views, rows, clocks).cost)
    table = np.concatenate(cost).reshape(len(mid), len(clock_scales))
    best = table.argmin(axis=1)
    profile = table.min(axis=1)
    lowest = np.flatnonzero(profile == minimum_filter1d(profile, 3))
    lowest = lowest[np.argsort(profile[lowest], kind="stable")][:keep]
    return tuple(
        ClockGuess(
            offset_s=float(mid[i] - clock_scales[best[i]] * middle),
            clock_scale=float(clock_scales[best[i]]),
            cost=float(profile[i]),
        )
        for i in lowest
    )
