"""Polishing of clocks without any model of the motion: rays of one target at one instant meet.

For every pair of cameras (a, b) with a common target, every thinned sighting of b is held against the ray of a at the
same common time, linear between a's own sightings:

    f = (C_b - C_a) . (d_a x d_b),   e = f / sigma_f        (sigma_f: noise only, first order)

Unknown are, of every camera but the reference, offset and stretch (t = s tau + beta), and of every camera a constant
rotation (camera axes) and a constant shift (ENU) with the instruments' priors, since 1.5 degrees of attitude hide
most of the signal. Gauss-Newton with a bounded loss whose scale shrinks to one from that of the unmodelled biases
(graduated non-convexity), so that gross outliers lose their say.

The cost is half a chi-square: sum of the bounded losses, plus a fixed charge for every sighting whose clock leaves it
without partner, plus the priors. Candidates of one problem share sightings and charges, so their costs compare.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.arrays import Floats
from pipeline.geometry.rotation import exp, matrix
from pipeline.solver.search_sweep import CAP, ClockRange, bounded, cross
from pipeline.solver.search_views import Track, View, thinned

LONELY = 0.75 * CAP**2 / 2
"""What a sighting without partner costs: three quarters of the worst loss."""
ROUNDS = 14
SAMPLES = 1600
"""Sightings that are compared, all pairs together; at least 120 for each pair."""


@dataclass(frozen=True, kw_only=True)
class ClockPrior:
    """What is known of a clock: an offset and its sigma (None: nothing), and the sigma of the stretch about one."""

    offset_s: float = 0.0
    offset_sigma_s: float | None = None
    stretch_sigma: float = 0.01
    allowed: ClockRange


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Clocks (offset, stretch) of the cameras set so far, and their half chi-square.

    overlap  share of the sightings that have a partner in time
    misfit   chi-square per equation of the median frame, where known; one where all is well
    sigma_s  of the common time of the middle of each camera's sightings, where known
    """

    clock: Mapping[str, tuple[float, float]]
    cost: float
    overlap: float = 1.0
    misfit: float = 0.0
    sigma_s: Mapping[str, float] = field(default_factory=dict)
    tilt_rad: Mapping[str, Floats] = field(default_factory=dict)
    shift_m: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Sightings `track` of camera `b` held against `partner` of camera `a` (places in the camera list)."""

    a: int
    b: int
    track: Track
    partner: Track


def pairs_of(views: Sequence[View], effort: float = 1.0) -> list[_Pair]:
    """Every pair of cameras with a common target; the one with fewer sightings is held against the other."""
    pairs = []
    each = int(effort * max(SAMPLES // max(len(views) * (len(views) - 1) // 2, 4), 120))
    for i, first in enumerate(views):
        for j in range(i + 1, len(views)):
            shared = [t for t in first.tracks if t in views[j].tracks]
            for target in shared:
                a, b = (i, j) if len(first.tracks[target]) >= len(views[j].tracks[target]) else (j, i)
                most = max(each // len(shared), 40)
                pairs.append(
                    _Pair(
                        a=a,
                        b=b,
                        track=thinned(views[b].tracks[target], 0.1, most),
                        partner=views[a].tracks[target],
                    )
                )
    return pairs


def polish(
    views: Sequence[View],
    clocks: Sequence[tuple[float, float]],
    priors: Sequence[ClockPrior | None],
    effort: float = 1.0,
) -> Fit:
    """The clocks of `views` moved downhill from `clocks`. A prior of None holds the clock (the reference camera).

    `effort` is the share of the sightings that is used.
    """
    pairs = pairs_of(views, effort)
    state = _State(
        clock=np.array(clocks, float), tilt=np.zeros((len(views), 3)), shift=np.zeros((len(views), 3)), views=views
    )
    start = _starting_scale(views)
    for i in range(ROUNDS):
        scale = max(start * 0.5**i, 1.0)
        step = _step(state, pairs, priors, scale)
        if step is None:
            break
        state = state.moved(step)
        if scale == 1.0 and np.abs(step[:, 0]).max() < 1e-4:
            break
    cost, overlap = _cost(state, pairs, priors)
    names = [v.camera for v in views]
    return Fit(
        clock={n: (float(c[0]), float(c[1])) for n, c in zip(names, state.clock, strict=True)},
        cost=cost,
        overlap=overlap,
        tilt_rad=dict(zip(names, state.tilt, strict=True)),
        shift_m=dict(zip(names, state.shift, strict=True)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """clock (c, 2) offset and stretch, tilt (c, 3), shift (c, 3)."""

    clock: Floats
    tilt: Floats
    shift: Floats
    views: Sequence[View]

    def moved(self, step: Floats) -> _State:
        """The state after a step (c, 8): time at mid-track, stretch, tilt, shift."""
        clock = self.clock.copy()
        for i, view in enumerate(self.views):
            middle = 0.5 * sum(view.span_s)
            clock[i, 1] += step[i, 1]
            clock[i, 0] += step[i, 0] - step[i, 1] * middle
        return _State(clock=clock, tilt=self.tilt + step[:, 2:5], shift=self.shift + step[:, 5:8], views=self.views)


def _starting_scale(views: Sequence[View]) -> float:
    """How far biases alone push a residual, in sigmas of the noise."""
    worst = 1.0
    for view in views:
        for track in view.tracks.values():
            noise = np.hypot(float(np.median(track.pixel_rad)), view.tilt_noise_rad)
            worst = max(worst, float(np.hypot(noise, view.tilt_rad) / noise))
    return min(worst, 64.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Residuals:
    """Of one pair: rows (m,) that have partners, residual in sigmas, its Jacobian with respect to 8 unknowns each."""

    residual: Floats
    by_a: Floats
    by_b: Floats
    lonely: int


def _residuals(state: _State, pair: _Pair) -> _Residuals:
    va, vb = state.views[pair.a], state.views[pair.b]
    (off_a, s_a), (off_b, s_b) = state.clock[pair.a], state.clock[pair.b]
    time = s_b * pair.track.time_s + off_b
    own = (time - off_a) / s_a
    at = pair.partner.at(own)
    use = at.holds
    track, own = pair.track.taken(use), own[use]
    axes_a = pair.partner.axes[at.near[use]]
    ray_a, ray_b = _turned(at.ray[use], axes_a, state.tilt[pair.a]), _turned(track.ray, track.axes, state.tilt[pair.b])
    base = track.centre_m + state.shift[pair.b] - at.centre_m[use] - state.shift[pair.a]
    early, late = pair.partner.at(own - 0.1), pair.partner.at(own + 0.1)
    ray_rate, centre_rate = (late.ray - early.ray) / 0.2, (late.centre_m - early.centre_m) / 0.2
    normal, by_ray_a, by_ray_b = cross(ray_a, ray_b), cross(ray_b, base), cross(base, ray_a)
    lever_a, lever_b = cross(ray_a, by_ray_a), cross(ray_b, by_ray_b)
    noise_a = pair.partner.pixel_rad[at.near[use]] ** 2 + va.tilt_noise_rad**2
    noise_b = track.pixel_rad**2 + vb.tilt_noise_rad**2
    shift = va.shift_noise_m**2 + vb.shift_noise_m**2
    variance = (lever_a**2).sum(1) * noise_a + (lever_b**2).sum(1) * noise_b + (normal**2).sum(1) * shift
    sigma = np.sqrt(variance + 1e-30)
    by_own = (by_ray_a * ray_rate).sum(1) - (normal * centre_rate).sum(1)
    by_time = by_own / s_a
    mid_a, mid_b = 0.5 * sum(va.span_s), 0.5 * sum(vb.span_s)
    tilt_a, tilt_b = (np.einsum("mij,mi->mj", r, v) for r, v in ((axes_a, lever_a), (track.axes, lever_b)))
    by_a = np.column_stack([-by_time, -by_time * (own - mid_a), tilt_a, -normal])
    by_b = np.column_stack([by_time, by_time * (track.time_s - mid_b), tilt_b, normal])
    return _Residuals(
        residual=(base * normal).sum(1) / sigma,
        by_a=by_a / sigma[:, None],
        by_b=by_b / sigma[:, None],
        lonely=int((~use).sum()),
    )


def _turned(ray: Floats, axes: Floats, tilt_rad: Floats) -> Floats:
    """Rays turned by a small rotation given in camera axes."""
    in_camera = np.einsum("mij,mi->mj", axes, ray) @ matrix(exp(tilt_rad)).T
    return np.asarray(np.einsum("mij,mj->mi", axes, in_camera))


def _step(state: _State, pairs: Sequence[_Pair], priors: Sequence[ClockPrior | None], scale: float) -> Floats | None:
    """One Gauss-Newton step (c, 8), or None where nothing overlaps any more."""
    normal, right, seen = _data(state, pairs, scale)
    if seen == 0:
        return None
    _add_priors(state, priors, normal, right)
    size = right.size
    step = np.linalg.solve(normal.reshape(size, size), right.reshape(size)).reshape(right.shape)
    limit = np.abs(step[:, 0]).max()
    return np.asarray(step * min(1.0, 1.0 / max(limit, 1e-12)))


def _data(state: _State, pairs: Sequence[_Pair], scale: float) -> tuple[Floats, Floats, int]:
    """Normal matrix (c, 8, c, 8) and right-hand side (c, 8) of the sightings alone, and how many of them count."""
    count = len(state.views)
    normal, right = np.zeros((count, 8, count, 8)), np.zeros((count, 8))
    seen = 0
    for pair in pairs:
        r = _residuals(state, pair)
        seen += len(r.residual)
        if len(r.residual) == 0:
            continue
        weight = (1 / (1 + (r.residual / (scale * CAP)) ** 2)) ** 2 / scale**2
        columns = ((pair.a, r.by_a), (pair.b, r.by_b))
        for i, left in columns:
            right[i] -= left.T @ (weight * r.residual)
            for j, other in columns:
                normal[i, :, j] += left.T @ (weight[:, None] * other)
    return normal, right, seen


def crossing_information(views: Sequence[View], clocks: Sequence[tuple[float, float]]) -> Floats:
    """What the sightings alone know (8 c, 8 c) of time at mid-track, stretch, tilt (3), shift (3) of each camera."""
    zero = np.zeros((len(views), 3))
    state = _State(clock=np.array(clocks, float), tilt=zero, shift=zero, views=views)
    size = 8 * len(views)
    return _data(state, pairs_of(views), _starting_scale(views))[0].reshape(size, size) * _starting_scale(views) ** 2


def _add_priors(state: _State, priors: Sequence[ClockPrior | None], normal: Floats, right: Floats) -> None:
    """Priors of clocks and biases, into the normal equations under construction."""
    axis = np.arange(8)
    for i, (view, prior) in enumerate(zip(state.views, priors, strict=True)):
        weight = np.concatenate([[0, 0], np.full(3, view.tilt_rad**-2), np.full(3, view.shift_m**-2)])
        normal[i, axis, i, axis] += weight
        right[i] -= weight * np.concatenate([[0, 0], state.tilt[i], state.shift[i]])
        if prior is None:
            normal[i, :2, i, :2] += np.eye(2) * 1e16
            continue
        offset, stretch = state.clock[i]
        middle = 0.5 * sum(view.span_s)
        precision, slope = stretch_pull(prior, stretch)
        normal[i, 1, i, 1] += precision
        right[i, 1] -= slope
        if prior.offset_sigma_s is not None:
            row = np.array([1.0, -middle]) / prior.offset_sigma_s
            normal[i, :2, i, :2] += np.outer(row, row)
            right[i, :2] -= row * (offset - prior.offset_s) / prior.offset_sigma_s


def prior_cost(prior: ClockPrior | None, offset_s: float, stretch: float) -> float:
    """Half chi-square of a clock under its prior.

    That of the stretch grows slowly, since stated rates may be plain wrong, but there is a wall where the search ends.
    """
    if prior is None:
        return 0.0
    cost = 0.5 * float(np.log1p(((stretch - 1) / prior.stretch_sigma) ** 2))
    cost += 0.5 * (_beyond(prior, stretch) / _wall(prior)) ** 2
    if prior.offset_sigma_s is not None:
        cost += 0.5 * ((offset_s - prior.offset_s) / prior.offset_sigma_s) ** 2
    return cost


def stretch_pull(prior: ClockPrior, stretch: float) -> tuple[float, float]:
    """Curvature (Gauss-Newton) and slope of the part of `prior_cost` that depends on the stretch."""
    pull = 1 / (prior.stretch_sigma**2 + (stretch - 1) ** 2)
    beyond, wall = _beyond(prior, stretch), _wall(prior)
    precision = pull + (wall**-2 if beyond != 0 else 0.0)
    return precision, pull * (stretch - 1) + beyond / wall**2


def _beyond(prior: ClockPrior, stretch: float) -> float:
    """How far a stretch is outside of what is searched."""
    away = stretch - 1
    return away - float(np.clip(away, -prior.allowed.stretch, prior.allowed.stretch))


def _wall(prior: ClockPrior) -> float:
    return max(0.02 * prior.allowed.stretch, 1e-7)


def _cost(state: _State, pairs: Sequence[_Pair], priors: Sequence[ClockPrior | None]) -> tuple[float, float]:
    total, lonely, paired = 0.0, 0, 0
    for pair in pairs:
        r = _residuals(state, pair)
        total += float(bounded(r.residual).sum())
        lonely, paired = lonely + r.lonely, paired + len(r.residual)
    for i, (view, prior) in enumerate(zip(state.views, priors, strict=True)):
        total += 0.5 * float((state.tilt[i] ** 2).sum() / view.tilt_rad**2)
        total += 0.5 * float((state.shift[i] ** 2).sum() / view.shift_m**2)
        total += prior_cost(prior, *state.clock[i])
    return total + LONELY * lonely, paired / max(paired + lonely, 1)
