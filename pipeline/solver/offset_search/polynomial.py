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

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry.rotation import skew
from pipeline.solver.observation.observations import across
from pipeline.solver.observation.symmetric import solved
from pipeline.solver.offset_search.sweep import ClockGuess, ClockRange, SetCamera, lowest_within
from pipeline.solver.offset_search.views import Track, View, share_together, thinned

COARSE = 100
"""Sightings by one camera in the coarse search, all targets together; of each target at least twenty."""
BATCH = 64
"""Clocks that are tried at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Products of one camera's sightings of one target, of fixed geometry: what every clock's normal matrix is made of.

    With A = T' over sigma (2 x 3), S = T' [d]x R over sigma (2 x 3) and the centre C:

    part      of the target's sightings, this camera's
    placed    (m, 13) A'A, A'A C and C'A'A C
    coupled   (m, 12) A'S and S'A C, transposed as rows
    turned    (m, 9) S'S
    """

    camera: int
    part: slice
    placed: Floats
    coupled: Floats
    turned: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Sightings of one target, all cameras together, of fixed geometry.

    camera   (m,) place in the list of views
    time_s   (m,) video time
    centre_m, ray  (3, m)
    """

    order: int
    camera: Ints
    time_s: Floats
    centre_m: Floats
    ray: Floats
    sigma_rad: Floats
    position_noise_m: Floats
    seen: tuple[Seen, ...]


def stacked_rows(views: Sequence[View], target: str, order: int, most: int = 40) -> Rows:
    """The sightings of one target by all `views`, at most `most` of each."""
    parts: list[tuple[int, View, Track]] = [
        (i, v, thinned(v.tracks[target], 0.0, most)) for i, v in enumerate(views) if target in v.tracks
    ]
    ends = np.cumsum([len(t) for _, _, t in parts])
    sigmas = [np.hypot(t.pixel_rad, v.attitude_noise_rad) for _, v, t in parts]
    return Rows(
        order=order,
        camera=np.concatenate([np.full(len(t), i) for i, _, t in parts]),
        time_s=np.concatenate([t.time_s for _, _, t in parts]),
        centre_m=np.concatenate([t.centre_m for _, _, t in parts]).T.copy(),
        ray=np.concatenate([t.ray for _, _, t in parts]).T.copy(),
        sigma_rad=np.concatenate(sigmas),
        position_noise_m=np.concatenate([np.full(len(t), v.position_noise_m) for _, v, t in parts]),
        seen=tuple(
            _seen(i, slice(end - len(t), end), t, sigma)
            for (i, _, t), end, sigma in zip(parts, ends, sigmas, strict=True)
        ),
    )


def _seen(camera: int, part: slice, track: Track, sigma: Floats) -> Seen:
    a = across(track.ray) / sigma[:, None, None]
    s = a @ skew(track.ray) @ track.axes
    square, centre = np.swapaxes(a, 1, 2) @ a, track.centre_m[:, :, None]
    there, m = square @ centre, len(track)
    mixed = np.swapaxes(a, 1, 2) @ s
    placed = [square.reshape(m, 9), there[..., 0], (there * centre).sum(1)]
    coupled = [mixed.reshape(m, 9), (np.swapaxes(mixed, 1, 2) @ centre)[..., 0]]
    return Seen(
        camera=camera, part=part, placed=np.hstack(placed), coupled=np.hstack(coupled),
        turned=(np.swapaxes(s, 1, 2) @ s).reshape(m, 9),
    )  # fmt: skip


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
    powers = [_powers((t - epoch[:, None]) / scale[:, None], 2 * r.order) for t, r in zip(times, rows, strict=True)]
    ranges = [np.ones_like(t) for t in times]
    found = _solved(views, rows, powers, ranges, biased=False)
    for _ in range(passes - 1):
        ranges = [_ranges(r, p, a)[0] for r, p, a in zip(rows, powers, found[1], strict=True)]
        found = _solved(views, rows, powers, ranges, biased=True)
    cost, coefficients, bias = found
    for r, p, a in zip(rows, powers, coefficients, strict=True):
        distance, behind = _ranges(r, p, a)
        cost = cost + (4.5 * behind + np.log(_spread_square(r, distance))).sum(axis=1)
    return Projected(cost=cost, coefficients=coefficients, bias=bias, epoch_s=epoch, scale_s=scale)


def _powers(u: Floats, highest: int) -> Floats:
    """Powers 0 to `highest` (g, highest + 1, m) of scaled times u (g, m)."""
    out = np.ones((len(u), highest + 1, u.shape[1]))
    for k in range(highest):
        np.multiply(out[:, k], u, out=out[:, k + 1])
    return out


def _ranges(rows: Rows, powers: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """Distances (g, m) from camera to target, and where the target would be behind the camera."""
    away = np.swapaxes(coefficients, 1, 2) @ powers[:, : rows.order + 1] - rows.centre_m
    ahead = np.einsum("gxm,xm->gm", away, rows.ray)
    return np.maximum(np.sqrt(np.einsum("gxm,gxm->gm", away, away)), 0.1), ahead < 0


def _spread_square(rows: Rows, ranges: Floats) -> Floats:
    """How much greater (g, m) a residual's variance is for the error of the camera's position; a near target is worth
    little."""
    return np.asarray(1 + (rows.position_noise_m / (ranges * rows.sigma_rad)) ** 2)


def _solved(
    views: Sequence[View], rows: Sequence[Rows], powers: Sequence[Floats], ranges: Sequence[Floats], *, biased: bool
) -> tuple[Floats, list[Floats], Floats]:
    """Motions (g, K + 1, 3) per target, biases (g, 6 c) and half chi-square (g,) of the linear problem."""
    g, size = len(powers[0]), 6 * len(views)
    prior = np.concatenate([[v.attitude_bias_rad**-2] * 3 + [v.position_bias_m**-2] * 3 for v in views])
    schur = np.zeros((g, size, size)) + np.diag(prior)
    right, square, kept = np.zeros((g, size)), np.zeros(g), []
    for r, phi, distance in zip(rows, powers, ranges, strict=True):
        motion, coupling, rest = _normal(r, phi, distance, size)
        n = motion.shape[1]
        motion += 1e-9 * np.trace(motion, axis1=1, axis2=2)[:, None, None] * np.eye(n) / n
        reduced = solved(motion, coupling)
        rest -= np.swapaxes(coupling, 1, 2) @ reduced
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


def _normal(rows: Rows, powers: Floats, ranges: Floats, size: int) -> tuple[Floats, Floats, Floats]:
    """Normal matrices of one target: motions (g, n, n), their coupling (g, n, size + 1) with biases and right-hand
    side, and those of the latter (g, size + 1, size + 1).

    Every block is a sum over sightings of a power of time, a weight, and a product that no clock changes, so that a
    camera's share of all of them is three products of matrices:

        sum of u^j A'A / r^2,   sum of u^j A'S / r,   sum of S'S        (each over the spread squared)
    """
    g, terms = len(powers), rows.order + 1
    index = np.arange(terms)
    spread = 1 / _spread_square(rows, ranges)
    motion = np.zeros((g, terms, terms, 3, 3))
    coupling, rest = np.zeros((g, terms, 3, size + 1)), np.zeros((g, size + 1, size + 1))
    for one in rows.seen:
        u, near, level = powers[:, :, one.part], 1 / ranges[:, one.part], spread[:, one.part]
        placed = _summed(u, level * near**2, one.placed)
        coupled = _summed(u[:, :terms], level * near, one.coupled)
        square = placed[..., :9].reshape(g, -1, 3, 3)
        motion += square[:, index[:, None] + index]
        turn = slice(6 * one.camera, 6 * one.camera + 3)
        shift = slice(6 * one.camera + 3, 6 * one.camera + 6)
        coupling[..., turn] = coupled[..., :9].reshape(g, terms, 3, 3)
        coupling[..., shift] = -square[:, :terms]
        coupling[..., size] += placed[:, :terms, 9:12]
        rest[:, turn, turn] = (level @ one.turned).reshape(g, 3, 3)
        rest[:, turn, shift] = -np.swapaxes(coupling[:, 0, :, turn], 1, 2)
        rest[:, shift, turn] = -coupling[:, 0, :, turn]
        rest[:, shift, shift] = square[:, 0]
        rest[:, turn, size] = rest[:, size, turn] = coupled[:, 0, 9:]
        rest[:, shift, size] = rest[:, size, shift] = -placed[:, 0, 9:12]
        rest[:, size, size] += placed[:, 0, 12]
    whole = np.swapaxes(motion, 2, 3).reshape(g, 3 * terms, 3 * terms)
    return whole, coupling.reshape(g, 3 * terms, size + 1), rest


def _summed(powers: Floats, weight: Floats, products: Floats) -> Floats:
    """Sums (g, j, p) of `products` (m, p) times powers of time (g, j, m) and weight (g, m): one product of matrices."""
    g, j, m = powers.shape
    return ((powers * weight[:, None]).reshape(g * j, m) @ products).reshape(g, j, -1)


def _together(mid_s: Floats, half_s: float, placed: Sequence[SetCamera]) -> Floats:
    """(g,) greatest share of the shorter span in which a camera, centred at `mid_s`, and a placed one look together."""
    best = np.zeros(len(mid_s))
    for p in placed:
        low, high = np.array(p.view.span_s) * p.clock_scale + p.offset_s
        best = np.maximum(best, share_together((mid_s - half_s, mid_s + half_s), (low, high)))
    return best


def sweep_polynomial(
    new: View, placed: Sequence[SetCamera], allowed: ClockRange, keep: int, orders: Mapping[str, int],
    overlap: float = 0.0,
) -> tuple[ClockGuess, ...]:  # fmt: skip
    """The best clocks of `new` against `placed` for targets of known polynomial order; local minima, best first.

    Only clocks under which `new` and some placed camera look together for the share `overlap` of the shorter of both.
    """
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
    mid = mid[_together(mid, half, placed) >= overlap]
    if not len(mid):
        return ()
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
    lowest = np.flatnonzero(profile == lowest_within(profile, 1))
    lowest = lowest[np.argsort(profile[lowest], kind="stable")][:keep]
    return tuple(
        ClockGuess(
            offset_s=float(mid[i] - clock_scales[best[i]] * middle),
            clock_scale=float(clock_scales[best[i]]),
            cost=float(profile[i]),
        )
        for i in lowest
    )
