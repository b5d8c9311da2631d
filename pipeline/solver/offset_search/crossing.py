"""Polishing of clocks without any model of the motion: rays of one target at one instant meet.

For every pair of cameras (a, b) with a common target, every thinned sighting of b is held against the ray of a at the
same common time, linear between a's own sightings:

    f = (C_b - C_a) . (d_a x d_b),   e = f / sigma_f        (sigma_f: noise only, first order)

Unknown are, of every camera but the reference, offset and clock scale (t = s tau + beta), and of every camera a
constant rotation (camera axes) and a constant position bias (ENU) with the instruments' priors, since 1.5 degrees of
attitude hide most of the signal. Gauss-Newton with a bounded loss whose scale shrinks to one from that of the
unmodelled biases (graduated non-convexity), so that gross outliers lose their say.

The cost is half a chi-square: sum of the bounded losses, plus a fixed charge for every sighting whose clock leaves it
without partner, plus the priors. Candidates of one problem share sightings and charges, so their costs compare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, groupby, pairwise

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry.rotation import exp, matrix
from pipeline.solver.observation.symmetric import solved
from pipeline.solver.offset_search.sweep import CAP, ClockRange, bounded, cross, inner
from pipeline.solver.offset_search.views import Track, View, thinned

LONELY = 0.75 * CAP**2 / 2
"""What a sighting without partner costs: three quarters of the worst loss."""
ROUNDS = 14
SAMPLES = 1600
"""Sightings that are compared, all pairs together; at least 120 for each pair."""


@dataclass(frozen=True, kw_only=True)
class ClockPrior:
    """What is known of a clock: an offset and its sigma (None: nothing), and the sigma of the clock_scale about one."""

    offset_s: float = 0.0
    offset_sigma_s: float | None = None
    clock_scale_sigma: float = 0.01
    allowed: ClockRange


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """Clocks (offset, clock_scale) of the cameras set so far, and their half chi-square.

    overlap  share of the sightings that have a partner in time
    misfit   chi-square per equation of the median frame, where known; one where all is well
    sigma_s  of the common time of the middle of each camera's sightings, where known
    """

    clock: Mapping[str, tuple[float, float]]
    cost: float
    overlap: float = 1.0
    misfit: float = 0.0
    sigma_s: Mapping[str, float] = field(default_factory=dict)
    attitude_bias_rad: Mapping[str, Floats] = field(default_factory=dict)
    position_bias_m: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sightings:
    """All sightings that are compared, m of them, those with the same partner track one after another.

    camera_a, camera_b  (m,) places in the camera list: each sighting of b is held against a ray of a
    pairs      places (a, b) and rows of every pair of cameras; partners: a's tracks and their rows
    time_s, centre_m, ray, axes  as in `Track`
    noise_a, noise_b, position_bias  (m,) variances: a's attitude and b's direction (rad^2), centres (m^2)
    """

    camera_a: Ints
    camera_b: Ints
    pairs: tuple[tuple[int, int, slice], ...]
    partners: tuple[tuple[Track, slice], ...]
    time_s: Floats
    centre_m: Floats
    ray: Floats
    axes: Floats
    noise_a: Floats
    noise_b: Floats
    position_bias: Floats


def sightings_of(views: Sequence[View], effort: float = 1.0) -> _Sightings | None:
    """Every pair of cameras with a common target; the one with fewer sightings is held against the other."""
    each = int(effort * max(SAMPLES // max(len(views) * (len(views) - 1) // 2, 4), 120))
    found = []
    for i, j in combinations(range(len(views)), 2):
        shared = [t for t in views[i].tracks if t in views[j].tracks]
        for target in shared:
            a, b = (i, j) if len(views[i].tracks[target]) >= len(views[j].tracks[target]) else (j, i)
            found.append((a, target, b, thinned(views[b].tracks[target], 0.1, max(each // len(shared), 40))))
    found.sort(key=lambda pair: pair[:3])
    return _stacked(views, found) if found else None


def _stacked(views: Sequence[View], found: Sequence[tuple[int, str, int, Track]]) -> _Sightings:
    """The tracks of b of all pairs (a, target, b, track) one after another."""
    ends = np.cumsum([0] + [len(track) for *_, track in found])
    rows = [slice(int(low), int(high)) for low, high in pairwise(ends)]
    a, b = (np.repeat([pair[k] for pair in found], np.diff(ends)) for k in (0, 2))
    attitude_bias, position_bias = (
        np.array([getattr(v, name) ** 2 for v in views]) for name in ("attitude_noise_rad", "position_noise_m")
    )
    partners = []
    for (i, target), group in groupby(zip(found, rows, strict=True), key=lambda item: item[0][:2]):
        own = [row for _, row in group]
        partners.append((views[i].tracks[target], slice(own[0].start, own[-1].stop)))
    return _Sightings(
        camera_a=a,
        camera_b=b,
        pairs=tuple((pair[0], pair[2], row) for pair, row in zip(found, rows, strict=True)),
        partners=tuple(partners),
        time_s=np.concatenate([track.time_s for *_, track in found]),
        centre_m=np.concatenate([track.centre_m for *_, track in found]),
        ray=np.concatenate([track.ray for *_, track in found]),
        axes=np.concatenate([track.axes for *_, track in found]),
        noise_a=attitude_bias[a],
        noise_b=np.concatenate([track.pixel_rad for *_, track in found]) ** 2 + attitude_bias[b],
        position_bias=position_bias[a] + position_bias[b],
    )


def polish(
    views: Sequence[View],
    clocks: Sequence[tuple[float, float]],
    priors: Sequence[ClockPrior | None],
    effort: float = 1.0,
) -> Hypothesis:
    """The clocks of `views` moved downhill from `clocks`. A prior of None holds the clock (the reference camera).

    `effort` is the share of the sightings that is used.
    """
    sightings = sightings_of(views, effort)
    state = _State(
        clock=np.array(clocks, float),
        attitude_bias=np.zeros((len(views), 3)),
        position_bias=np.zeros((len(views), 3)),
        views=views,
    )
    start = _starting_scale(views)
    for i in range(ROUNDS):
        scale = max(start * 0.5**i, 1.0)
        step = _step(state, sightings, priors, scale)
        if step is None:
            break
        state = state.moved(step)
        if scale == 1.0 and np.abs(step[:, 0]).max() < 1e-4:
            break
    cost, overlap = _cost(state, sightings, priors)
    names = [v.camera for v in views]
    return Hypothesis(
        clock={n: (float(c[0]), float(c[1])) for n, c in zip(names, state.clock, strict=True)},
        cost=cost,
        overlap=overlap,
        attitude_bias_rad=dict(zip(names, state.attitude_bias, strict=True)),
        position_bias_m=dict(zip(names, state.position_bias, strict=True)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """clock (c, 2) offset and clock_scale, attitude_bias (c, 3), position_bias (c, 3)."""

    clock: Floats
    attitude_bias: Floats
    position_bias: Floats
    views: Sequence[View]

    def moved(self, step: Floats) -> _State:
        """The state after a step (c, 8): time at mid-track, clock_scale, attitude_bias, position_bias."""
        clock = self.clock.copy()
        for i, view in enumerate(self.views):
            middle = 0.5 * sum(view.span_s)
            clock[i, 1] += step[i, 1]
            clock[i, 0] += step[i, 0] - step[i, 1] * middle
        return _State(
            clock=clock,
            attitude_bias=self.attitude_bias + step[:, 2:5],
            position_bias=self.position_bias + step[:, 5:8],
            views=self.views,
        )


def _starting_scale(views: Sequence[View]) -> float:
    """How far biases alone push a residual, in sigmas of the noise."""
    worst = 1.0
    for view in views:
        for track in view.tracks.values():
            noise = np.hypot(float(np.median(track.pixel_rad)), view.attitude_noise_rad)
            worst = max(worst, float(np.hypot(noise, view.attitude_bias_rad) / noise))
    return min(worst, 64.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Residuals:
    """Residuals (m,) in sigmas, their Jacobian (m, 16) by 8 unknowns of a and of b, and which have partners (m,)."""

    residual: Floats
    jacobian: Floats
    paired: Bools


def _residuals(state: _State, sightings: _Sightings) -> _Residuals:
    s, a, b = sightings, sightings.camera_a, sightings.camera_b
    clock_a, clock_b = state.clock[a], state.clock[b]
    own = (clock_b[:, 1] * s.time_s + clock_b[:, 0] - clock_a[:, 0]) / clock_a[:, 1]
    packed, axes_a, pixel_a, paired = _partners(s, own)
    turn = matrix(exp(state.attitude_bias))
    ray_a, ray_b = _turned(packed[:, 3:6], axes_a, turn[a]), _turned(s.ray, s.axes, turn[b])
    base = s.centre_m + state.position_bias[b] - packed[:, :3] - state.position_bias[a]
    normal, by_ray_a, by_ray_b = cross(ray_a, ray_b), cross(ray_b, base), cross(base, ray_a)
    lever_a, lever_b = cross(ray_a, by_ray_a), cross(ray_b, by_ray_b)
    variance = inner(lever_a, lever_a) * (pixel_a**2 + s.noise_a) + inner(lever_b, lever_b) * s.noise_b
    sigma = np.sqrt(variance + inner(normal, normal) * s.position_bias + 1e-30)
    by_own = inner(by_ray_a, packed[:, 9:]) - inner(normal, packed[:, 6:9])
    by_time = (by_own / clock_a[:, 1])[:, None]
    middle = np.array([0.5 * sum(v.span_s) for v in state.views])
    jacobian = np.empty((len(a), 16))
    for first, time, axes, lever, sign in (
        (0, own - middle[a], axes_a, lever_a, -1.0),
        (8, s.time_s - middle[b], s.axes, lever_b, 1.0),
    ):
        jacobian[:, first : first + 1] = sign * by_time
        jacobian[:, first + 1 : first + 2] = sign * by_time * time[:, None]
        jacobian[:, first + 2 : first + 5] = np.einsum("mij,mi->mj", axes, lever)
        jacobian[:, first + 5 : first + 8] = sign * normal
    jacobian *= (paired / sigma)[:, None]
    return _Residuals(residual=np.where(paired, inner(base, normal) / sigma, 0.0), jacobian=jacobian, paired=paired)


def _partners(s: _Sightings, own_s: Floats) -> tuple[Floats, Floats, Floats, Bools]:
    """`Track.packed` (m, 12), axes (m, 3, 3) and pixel sigma (m,) of the partners at their own video times (m,)."""
    packed, axes = np.empty((len(own_s), 12)), np.empty((len(own_s), 3, 3))
    pixel, paired = np.empty(len(own_s)), np.empty(len(own_s), dtype=bool)
    for track, rows in s.partners:
        place = track.between(own_s[rows])
        share = place.share[:, None]
        packed[rows] = (1 - share) * track.packed[place.left] + share * track.packed[place.right]
        near = np.where(place.share < 0.5, place.left, place.right)
        axes[rows], pixel[rows], paired[rows] = track.axes[near], track.pixel_rad[near], place.holds
    packed[:, 3:6] /= np.sqrt(inner(packed[:, 3:6], packed[:, 3:6]))[:, None]
    return packed, axes, pixel, paired


def _turned(ray: Floats, axes: Floats, turn: Floats) -> Floats:
    """Rays (m, 3) turned by rotations (m, 3, 3) given in camera axes."""
    in_camera = np.einsum("mij,mi->mj", axes, ray)
    return np.asarray(np.einsum("mij,mj->mi", axes, np.einsum("mij,mj->mi", turn, in_camera)))


def _step(
    state: _State, sightings: _Sightings | None, priors: Sequence[ClockPrior | None], scale: float
) -> Floats | None:
    """One Gauss-Newton step (c, 8), or None where nothing overlaps any more."""
    normal, right, seen = _data(state, sightings, scale)
    if seen == 0:
        return None
    _add_priors(state, priors, normal, right)
    size = right.size
    step = solved(normal.reshape(size, size), right.reshape(size, 1)).reshape(right.shape)
    if not np.isfinite(step).all():
        return None
    limit = np.abs(step[:, 0]).max()
    return np.asarray(step * min(1.0, 1.0 / max(limit, 1e-12)))


def _data(state: _State, sightings: _Sightings | None, scale: float) -> tuple[Floats, Floats, int]:
    """Normal matrix (c, 8, c, 8) and right-hand side (c, 8) of the sightings alone, and how many of them count."""
    count = len(state.views)
    normal, right = np.zeros((count, 8, count, 8)), np.zeros((count, 8))
    if sightings is None:
        return normal, right, 0
    r = _residuals(state, sightings)
    weight = (1 / (1 + (r.residual / (scale * CAP)) ** 2)) ** 2 / scale**2
    weighted = r.jacobian * weight[:, None]
    for a, b, rows in sightings.pairs:
        own = weighted[rows].T @ r.jacobian[rows]
        pull = r.residual[rows] @ weighted[rows]
        for i, left in ((a, slice(0, 8)), (b, slice(8, 16))):
            right[i] -= pull[left]
            for j, other in ((a, slice(0, 8)), (b, slice(8, 16))):
                normal[i, :, j] += own[left, other]
    return normal, right, int(r.paired.sum())


def crossing_information(views: Sequence[View], clocks: Sequence[tuple[float, float]]) -> Floats:
    """What the sightings alone know (8 c, 8 c) of every camera: time at mid-track, clock scale, biases (6)."""
    zero = np.zeros((len(views), 3))
    state = _State(clock=np.array(clocks, float), attitude_bias=zero, position_bias=zero, views=views)
    size = 8 * len(views)
    return (
        _data(state, sightings_of(views), _starting_scale(views))[0].reshape(size, size) * _starting_scale(views) ** 2
    )


def _add_priors(state: _State, priors: Sequence[ClockPrior | None], normal: Floats, right: Floats) -> None:
    """Priors of clocks and biases, into the normal equations under construction."""
    axis = np.arange(8)
    for i, (view, prior) in enumerate(zip(state.views, priors, strict=True)):
        weight = np.concatenate([[0, 0], np.full(3, view.attitude_bias_rad**-2), np.full(3, view.position_bias_m**-2)])
        normal[i, axis, i, axis] += weight
        right[i] -= weight * np.concatenate([[0, 0], state.attitude_bias[i], state.position_bias[i]])
        if prior is None:
            normal[i, :2, i, :2] += np.eye(2) * 1e16
            continue
        offset, clock_scale = state.clock[i]
        middle = 0.5 * sum(view.span_s)
        precision, slope = clock_scale_pull(prior, clock_scale)
        normal[i, 1, i, 1] += precision
        right[i, 1] -= slope
        if prior.offset_sigma_s is not None:
            row = np.array([1.0, -middle]) / prior.offset_sigma_s
            normal[i, :2, i, :2] += np.outer(row, row)
            right[i, :2] -= row * (offset - prior.offset_s) / prior.offset_sigma_s


def prior_cost(prior: ClockPrior | None, offset_s: float, clock_scale: float) -> float:
    """Half chi-square of a clock under its prior.

    That of the clock scale grows slowly, since stated rates may be plain wrong, with a wall where the search ends.
    """
    if prior is None:
        return 0.0
    cost = 0.5 * float(np.log1p(((clock_scale - 1) / prior.clock_scale_sigma) ** 2))
    cost += 0.5 * (_beyond(prior, clock_scale) / _wall(prior)) ** 2
    if prior.offset_sigma_s is not None:
        cost += 0.5 * ((offset_s - prior.offset_s) / prior.offset_sigma_s) ** 2
    return cost


def clock_scale_pull(prior: ClockPrior, clock_scale: float) -> tuple[float, float]:
    """Curvature (Gauss-Newton) and slope of the part of `prior_cost` that depends on the clock_scale."""
    pull = 1 / (prior.clock_scale_sigma**2 + (clock_scale - 1) ** 2)
    beyond, wall = _beyond(prior, clock_scale), _wall(prior)
    precision = pull + (wall**-2 if beyond != 0 else 0.0)
    return precision, pull * (clock_scale - 1) + beyond / wall**2


def _beyond(prior: ClockPrior, clock_scale: float) -> float:
    """How far a clock_scale is outside of what is searched."""
    away = clock_scale - 1
    return away - float(np.clip(away, -prior.allowed.clock_scale, prior.allowed.clock_scale))


def _wall(prior: ClockPrior) -> float:
    return max(0.02 * prior.allowed.clock_scale, 1e-7)


def _cost(state: _State, sightings: _Sightings | None, priors: Sequence[ClockPrior | None]) -> tuple[float, float]:
    total, lonely, paired = 0.0, 0, 0
    if sightings is not None:
        r = _residuals(state, sightings)
        total, paired = float(bounded(r.residual).sum()), int(r.paired.sum())
        lonely = len(r.paired) - paired
    for i, (view, prior) in enumerate(zip(state.views, priors, strict=True)):
        total += 0.5 * float((state.attitude_bias[i] ** 2).sum() / view.attitude_bias_rad**2)
        total += 0.5 * float((state.position_bias[i] ** 2).sum() / view.position_bias_m**2)
        total += prior_cost(prior, *state.clock[i])
    return total + LONELY * lonely, paired / max(paired + lonely, 1)
