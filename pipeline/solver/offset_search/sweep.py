"""Coarse search of one camera's clock against cameras whose clocks are set: every offset, every rate, no start.

Two rays of one target at one instant meet (paper eq. 6 with two cameras):

    f = (C_b - C_a) . (d_a x d_b) = 0,   residual e = f / sigma_f

with sigma_f from the angles' and centres' sigmas to first order (Sampson). Each of some hundred sightings m of the new
camera is held against the set cameras at every instant k of a grid of common time: a table of losses L[m, k]. A clock
t = T + s (tau_m - tau_mid) is a straight line through that table, so the cost of all offsets at one clock scale s is a
sum of shifted rows. The loss is bounded,

    rho(e) = k^2/2 * e^2 / (e^2 + k^2),

and a sighting that a clock leaves without partner is charged what a random partner costs on average: overlap is
earned, and a clock under which nothing overlaps wins nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.offset_search.views import Track, View, thinned

CAP = 3.0
"""k of the bounded loss, in sigmas."""
SAMPLES = 400
"""Sightings of the new camera that are swept."""
LONGEST = 8000
"""Instants in the grid of common time, at most."""


@dataclass(frozen=True, kw_only=True)
class ClockRange:
    """Where a clock may lie: offset beta within [low, high], s = nominal rate / alpha within 1 +- `clock_scale`."""

    low_s: float
    high_s: float
    clock_scale: float


@dataclass(frozen=True, kw_only=True)
class ClockGuess:
    """A clock t = clock_scale * tau + offset, and what it costs."""

    offset_s: float
    clock_scale: float
    cost: float = 0.0


def bounded(residual: Floats) -> Floats:
    """Half the squared residual where it is small, at most CAP^2 / 2."""
    square = residual**2
    return np.asarray(0.5 * CAP**2 * square / (square + CAP**2))


def cross(a: Floats, b: Floats) -> Floats:
    """Vector products (..., 3); numpy's own takes most of its time to look at the axes."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def inner(a: Floats, b: Floats) -> Floats:
    """Inner products (n,) of vectors (n, 3)."""
    return np.asarray(np.einsum("ni,ni->n", a, b))


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """Rays (n, 3) from centres (n, 3) with the sigma of their directions (n,)."""

    centre_m: Floats
    ray: Floats
    sigma_rad: Floats


def crossing_residuals(a: Rays, b: Rays, position_bias_m: float) -> Floats:
    """e (b, a) in sigmas of every ray of b with every ray of a; inf where they meet behind a camera.

    With w the base line and c = a . b only inner products are needed, so that a table costs a few matrix products:
    |a x b|^2 = 1 - c^2, a's lever is |a x (w x b)|^2 = w^2 c^2 - 2 c (w . a)(w . b) + (w . a)^2, and b's likewise.
    """
    moment_a, moment_b = cross(a.centre_m, a.ray), cross(b.ray, b.centre_m)
    cosine = b.ray @ a.ray.T
    triple = moment_b @ a.ray.T - b.ray @ moment_a.T
    along_a = b.centre_m @ a.ray.T - inner(a.centre_m, a.ray)
    along_b = inner(b.ray, b.centre_m)[:, None] - b.ray @ a.centre_m.T
    base = inner(b.centre_m, b.centre_m)[:, None] + inner(a.centre_m, a.centre_m) - 2 * b.centre_m @ a.centre_m.T
    apart = 1 - cosine**2
    common = cosine * (cosine * base - 2 * along_a * along_b)
    square_a, square_b = a.sigma_rad**2, b.sigma_rad[:, None] ** 2
    variance = (common + along_a**2) * square_a + (common + along_b**2) * square_b + apart * position_bias_m**2
    residual = triple / np.sqrt(np.maximum(variance, 1e-30))
    behind = (along_a < cosine * along_b) | (cosine * along_a < along_b)
    residual[behind & (apart > 9 * (square_a + square_b))] = np.inf
    return np.asarray(residual)


@dataclass(frozen=True, kw_only=True, eq=False)
class SetCamera:
    """A camera whose clock is set: t = clock_scale * tau + offset."""

    view: View
    offset_s: float
    clock_scale: float


def sweep(new: View, placed: Sequence[SetCamera], allowed: ClockRange, keep: int) -> tuple[ClockGuess, ...]:
    """The best clocks of `new` against `placed`, at most `keep`, best first; none where nothing overlaps."""
    shared = [t for t in new.tracks if any(t in p.view.tracks for p in placed)]
    step = _grid_step(new, shared)
    samples = _samples(new, shared)
    if not samples:
        return ()
    begin, end = _common_span(placed, shared)
    step = max(step, (end - begin) / LONGEST)
    grid = np.arange(begin, end + step, step)
    loss = np.concatenate([_loss_table(new, placed, t, track, grid) for t, track in samples])
    time = np.concatenate([track.time_s for _, track in samples])
    known = np.isfinite(loss)
    if not known.any():
        return ()
    null = float(loss[known].mean())
    return _lines(np.where(known, loss - null, 0.0), time, begin, step, allowed, keep, null)


def _grid_step(new: View, shared: Sequence[str]) -> float:
    """Seconds in which a ray turns by about its own sigma."""
    steps = []
    for target in shared:
        track = thinned(new.tracks[target], 0.1, 4000)
        turn = np.linalg.norm(np.diff(track.ray, axis=0), axis=1) / np.diff(track.time_s)
        sigma = np.sqrt(np.median(track.pixel_rad) ** 2 + new.attitude_bias_rad**2 + new.attitude_noise_rad**2)
        steps.append(0.7 * sigma / max(float(np.percentile(turn, 80)), 1e-9))
    return float(np.clip(min(steps), 0.04, 0.25))


def _samples(new: View, shared: Sequence[str]) -> list[tuple[str, Track]]:
    most = max(SAMPLES // max(len(shared), 1), 60)
    return [(t, thinned(new.tracks[t], 0.1, most)) for t in shared]


def _common_span(placed: Sequence[SetCamera], shared: Sequence[str]) -> tuple[float, float]:
    ends = [
        p.clock_scale * np.array([track.time_s[0], track.time_s[-1]]) + p.offset_s
        for p in placed
        for target, track in p.view.tracks.items()
        if target in shared
    ]
    return float(min(e[0] for e in ends)), float(max(e[1] for e in ends))


def _loss_table(new: View, placed: Sequence[SetCamera], target: str, track: Track, grid: Floats) -> Floats:
    """Mean loss (m, k) of each sighting at each instant against the placed cameras that see the target then."""
    total = np.zeros((len(track), len(grid)))
    count = np.zeros(len(grid))
    for other in placed:
        if target not in other.view.tracks:
            continue
        partner = other.view.tracks[target]
        at = partner.at((grid - other.offset_s) / other.clock_scale)
        seen = np.flatnonzero(at.holds)
        if len(seen) == 0:
            continue
        count[seen] += 1
        tilt = (
            other.view.attitude_bias_rad**2 + other.view.attitude_noise_rad**2,
            new.attitude_bias_rad**2 + new.attitude_noise_rad**2,
        )
        sigma_a = np.sqrt(partner.pixel_rad[at.near[seen]] ** 2 + tilt[0])
        sigma_b = np.sqrt(track.pixel_rad**2 + tilt[1])
        shift = np.sqrt(sum(v.position_bias_m**2 + v.position_noise_m**2 for v in (new, other.view)))
        middle = at.centre_m[seen].mean(axis=0)
        partners = Rays(centre_m=at.centre_m[seen] - middle, ray=at.ray[seen], sigma_rad=sigma_a)
        for m in range(0, len(track), 32):
            rows = slice(m, m + 32)
            own = Rays(centre_m=track.centre_m[rows] - middle, ray=track.ray[rows], sigma_rad=sigma_b[rows])
            residual = crossing_residuals(partners, own, float(shift))
            with np.errstate(invalid="ignore"):
                lost = bounded(residual)
            total[rows, seen] += np.where(np.isfinite(residual), lost, CAP**2 / 2)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _lines(
    gain: Floats, time_s: Floats, begin_s: float, step_s: float, allowed: ClockRange, keep: int, null: float
) -> tuple[ClockGuess, ...]:
    """Sums of `gain` (m, k) along the straight lines of all allowed clocks; the lowest, apart from each other."""
    middle = 0.5 * (time_s.min() + time_s.max())
    half = max(0.5 * float(np.ptp(time_s)), step_s)
    count = int(np.ceil(allowed.clock_scale / (2 * step_s / half)))
    clock_scales = 1 + (np.linspace(-allowed.clock_scale, allowed.clock_scale, 2 * count + 1) if count else np.zeros(1))
    costs, offsets = [], []
    for clock_scale in clock_scales:
        first = int(np.floor((clock_scale * middle + allowed.low_s - begin_s) / step_s))
        last = int(np.ceil((clock_scale * middle + allowed.high_s - begin_s) / step_s))
        costs.append(_shifted_sums(gain, np.round(clock_scale * (time_s - middle) / step_s).astype(int), first, last))
        offsets.append(begin_s + step_s * np.arange(first, last + 1) - clock_scale * middle)
    return _basins(costs, offsets, clock_scales, middle, step_s, keep, null * len(time_s))


def _shifted_sums(gain: Floats, lag: Ints, first: int, last: int) -> Floats:
    """Sum over m of gain[m, lag_m + s] for every s from `first` to `last`; zero outside of the table."""
    total = np.zeros(last - first + 1)
    low, high = np.maximum(first + lag, 0), np.minimum(last + lag, gain.shape[1] - 1) + 1
    to, end = low - lag - first, high - lag - first
    places = np.stack([np.arange(len(lag)), low, high, to, end], axis=1)[low < high]
    for m, start, stop, place, after in places.tolist():
        total[place:after] += gain[m, start:stop]
    return total


def _basins(
    costs: Sequence[Floats],
    offsets: Sequence[Floats],
    clock_scales: Floats,
    middle_s: float,
    step_s: float,
    keep: int,
    base: float,
) -> tuple[ClockGuess, ...]:
    """The local minima, over the common time at mid-track, of the lowest cost of any clock_scale; best first."""
    cost = np.concatenate(costs)
    offset = np.concatenate(offsets)
    clock_scale = np.repeat(clock_scales, [len(c) for c in costs])
    bins = np.round((offset + clock_scale * middle_s) / step_s).astype(np.int64)
    bins -= bins.min()
    profile = np.full(bins.max() + 1, np.inf)
    np.minimum.at(profile, bins, cost)
    lowest = (profile == lowest_within(profile, max(int(1.0 / step_s), 1))) & (profile < 0)
    is_best = lowest[bins] & (cost == profile[bins])
    best = np.flatnonzero(is_best)[np.argsort(cost[is_best], kind="stable")][:keep]
    return tuple(
        ClockGuess(offset_s=float(offset[i]), clock_scale=float(clock_scale[i]), cost=float(base + cost[i]))
        for i in best
    )


def lowest_within(values: Floats, reach: int) -> Floats:
    """The lowest of the values (n,) that lie up to `reach` places from each."""
    padded = np.pad(values, reach, constant_values=np.inf)
    width = 1
    while 2 * width <= 2 * reach + 1:  # of twice as many values each time
        padded = np.minimum(padded[: len(padded) - width], padded[width:])
        width *= 2
    return np.minimum(padded[: len(values)], padded[2 * reach + 1 - width :][: len(values)])
