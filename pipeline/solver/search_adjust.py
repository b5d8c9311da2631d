"""Polishing of clocks where every target moves as a polynomial: Levenberg-Marquardt on motions, clocks and biases.

    y = X_n(s_c tau + beta_c) - C - p_c,   d = R exp(w_c) R' d_measured,   e = T' y / (d . y)        (an angle)

The covariance of the residuals of one frame is exact to first order,

    S_f = diag(pixel) + attitude^2 J_w J_w' + position^2 J_p J_p',

so what a frame's own attitude and position errors do to all of its targets at once costs nothing extra, and the angles
between targets count with the pixel's small sigma. Frames whose chi-square is far beyond their size are weighted down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import Floats, Ints
from pipeline.geometry.rotation import exp, matrix, skew
from pipeline.solver.search_crossing import ClockPrior, Fit, prior_cost
from pipeline.solver.search_polynomial import project_motion, stacked_rows, tangents
from pipeline.solver.search_views import View

FRAMES = 500
"""Frames of all cameras together that are adjusted, at least sixty of each."""
ITERATIONS = 15
EXTRAPOLATED = 12.5
"""Half chi-square, in units of weight, that a clock without any overlap must win by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frames:
    """Some frames of one camera, a slot per target; empty slots have weight zero.

    time_s (f,), present (f, n), centre_m (f, 3), ray (f, n, 3), axes (f, 3, 3), pixel_rad (f, n)
    """

    time_s: Floats
    present: Floats
    centre_m: Floats
    ray: Floats
    axes: Floats
    pixel_rad: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class _Point:
    """Where the adjustment stands: clock (c, 2), tilt (c, 3), shift (c, 3), coefficients (K + 1, 3) per target."""

    clock: Floats
    tilt: Floats
    shift: Floats
    motion: list[Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Setup:
    """What stays while the adjustment moves."""

    views: Sequence[View]
    priors: Sequence[ClockPrior | None]
    frames: Sequence[_Frames]
    middle_s: Floats
    orders: Sequence[int]
    epoch_s: float
    scale_s: float
    usual: Sequence[float] = ()

    @property
    def size(self) -> int:
        return 8 * len(self.views) + sum(3 * (k + 1) for k in self.orders)


def polish_polynomial(
    views: Sequence[View],
    clocks: Sequence[tuple[float, float]],
    priors: Sequence[ClockPrior | None],
    effort: float = 1.0,
    *,
    orders: Mapping[str, int],
) -> Fit:
    """The clocks of `views` moved downhill from `clocks`, for targets of known polynomial order.

    `effort` is the share of the frames that is used.
    """
    wanted = [t for t in orders if any(t in v.tracks for v in views)]
    setup, point = _start(views, np.array(clocks, float), priors, wanted, orders, effort)
    normal, right, cost = _normal(setup, point)
    damping = 1e-3
    for _ in range(ITERATIONS):
        step = _step(normal, right, damping)
        trial = _moved(setup, point, step)
        new = _normal(setup, trial)
        if not new[2] < cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gained, (normal, right, cost), point = cost - new[2], new, trial
        damping = max(damping / 10, 1e-9)
        if gained < 1e-3:
            break
    return _fit(setup, point, cost)


def _fit(setup: _Setup, point: _Point, cost: float) -> Fit:
    overlap = _overlap(setup, point)
    names = [v.camera for v in setup.views]
    equations = 2 * sum(float(f.present.sum()) for f in setup.frames)
    unit = max(1.0, 2 * cost / max(equations, 1.0))
    return Fit(
        clock={n: (float(c[0]), float(c[1])) for n, c in zip(names, point.clock, strict=True)},
        cost=cost if overlap > 0 else cost + EXTRAPOLATED * unit,
        overlap=max(overlap, 1e-9),
        tilt_rad=dict(zip(names, point.tilt, strict=True)),
        shift_m=dict(zip(names, point.shift, strict=True)),
    )


def _overlap(setup: _Setup, point: _Point) -> float:
    """Smallest share, over the cameras, of its span in which some other camera looks too."""
    spans = [np.array(v.span_s) * c[1] + c[0] for v, c in zip(setup.views, point.clock, strict=True)]
    shares = []
    for i, (low, high) in enumerate(spans):
        both = [min(high, b) - max(low, a) for j, (a, b) in enumerate(spans) if j != i]
        shares.append(max([0.0, *both]) / max(high - low, 1e-9))
    return float(min(shares))


def _start(
    views: Sequence[View],
    clocks: Floats,
    priors: Sequence[ClockPrior | None],
    targets: Sequence[str],
    orders: Mapping[str, int],
    effort: float,
) -> tuple[_Setup, _Point]:
    """The linear solution at the given clocks is where the adjustment starts."""
    rows = [stacked_rows(views, t, orders[t]) for t in targets]
    linear = project_motion(views, rows, clocks[None])
    each = max(int(effort * max(FRAMES // len(views), 60)), 25)
    frames = [_frames(v, targets, each) for v in views]
    setup = _Setup(
        views=views,
        priors=priors,
        frames=frames,
        middle_s=np.array([0.5 * sum(v.span_s) for v in views]),
        orders=[orders[t] for t in targets],
        epoch_s=float(linear.epoch_s[0]),
        scale_s=float(linear.scale_s[0]),
        usual=[_widening(f, _spread_by_attitude(v, f)) for v, f in zip(views, frames, strict=True)],
    )
    bias = linear.bias[0].reshape(len(views), 2, 3)
    motion = [a[0] for a in linear.coefficients]
    return setup, _Point(clock=clocks, tilt=bias[:, 0], shift=bias[:, 1], motion=motion)


def _frames(view: View, targets: Sequence[str], most: int) -> _Frames:
    """At most `most` frames of a camera, spread evenly."""
    frames: Ints = np.unique(np.concatenate([view.tracks[t].frame for t in targets if t in view.tracks]))
    if len(frames) > most:
        frames = frames[np.linspace(0, len(frames) - 1, most).round().astype(np.int64)]
    f, n = len(frames), len(targets)
    time, centre, axes = np.zeros(f), np.zeros((f, 3)), np.zeros((f, 3, 3))
    present, pixel, ray = np.zeros((f, n)), np.ones((f, n)), np.tile([0.0, 0.0, 1.0], (f, n, 1))
    for k, target in enumerate(targets):
        if target not in view.tracks:
            continue
        track = view.tracks[target]
        mine = np.isin(track.frame, frames)
        at = np.searchsorted(frames, track.frame[mine])
        time[at], centre[at], axes[at] = track.time_s[mine], track.centre_m[mine], track.axes[mine]
        present[at, k], pixel[at, k], ray[at, k] = 1.0, track.pixel_rad[mine], track.ray[mine]
    return _Frames(time_s=time, present=present, centre_m=centre, ray=ray, axes=axes, pixel_rad=pixel)


def _normal(setup: _Setup, point: _Point) -> tuple[Floats, Floats, float]:
    """Normal matrix, right-hand side and half chi-square, priors included."""
    normal, right, cost = _priors(setup, point)
    for i, frames in enumerate(setup.frames):
        residual, jacobian, covariance = _camera(setup, point, i, frames)
        lower: Floats = np.linalg.cholesky(covariance)
        white = np.linalg.solve(lower, np.concatenate([residual[..., None], jacobian], axis=2))
        square = (white[..., 0] ** 2).sum(1)
        size = 2 * frames.present.sum(1)
        limit = size + 6 * np.sqrt(2 * size) + 1e-9
        weight = np.minimum(1.0, limit / np.maximum(square, 1e-30))
        cost += _widening(frames, lower) - setup.usual[i]
        cost += 0.5 * float(np.where(square <= limit, square, limit * (1 + np.log(square / limit + 1e-30))).sum())
        flat = (white * np.sqrt(weight)[:, None, None]).reshape(-1, white.shape[2])
        columns = _columns(setup, i)
        gram = flat.T @ flat
        normal[np.ix_(columns, columns)] += gram[1:, 1:]
        right[columns] -= gram[1:, 0]
    return normal, right, cost


def _widening(frames: _Frames, lower: Floats) -> float:
    """Logarithm of how much wider than the pixel the predicted residuals are.

    Part of the likelihood, counted from what attitude errors alone make of it; without it a target that rides along
    with a camera, where position errors excuse every angle, would explain everything.
    """
    plain = np.where(frames.present > 0, np.log(frames.pixel_rad), 0.0)
    return float(np.log(np.diagonal(lower, axis1=1, axis2=2)).sum() - 2 * plain.sum())


def _spread_by_attitude(view: View, frames: _Frames) -> Floats:
    """Cholesky factor (f, 2 n, 2 n) of the covariance that pixel and attitude alone give."""
    f, n = frames.present.shape
    basis = tangents(frames.ray.reshape(-1, 3)).reshape(f, n, 2, 3)
    there = np.repeat(frames.present, 2, axis=1)
    tilt = (basis @ skew(frames.ray) @ frames.axes[:, None]).reshape(f, 2 * n, 3) * there[..., None]
    own = np.where(there > 0, np.repeat(frames.pixel_rad, 2, axis=1) ** 2, 1.0)
    covariance = own[..., None] * np.eye(2 * n) + view.tilt_noise_rad**2 * tilt @ np.swapaxes(tilt, 1, 2)
    return np.asarray(np.linalg.cholesky(covariance))


def _columns(setup: _Setup, camera: int) -> Ints:
    """Unknowns that a camera's frames touch: its own eight, then every motion."""
    motions = np.arange(8 * len(setup.views), setup.size)
    return np.concatenate([8 * camera + np.arange(8), motions])


def _camera(setup: _Setup, point: _Point, i: int, frames: _Frames) -> tuple[Floats, Floats, Floats]:
    """Residuals (f, 2 n), Jacobian (f, 2 n, p) and covariance (f, 2 n, 2 n) of one camera's frames."""
    view = setup.views[i]
    f, n = frames.present.shape
    turn = frames.axes @ matrix(exp(point.tilt[i])) @ np.swapaxes(frames.axes, 1, 2)
    ray = frames.ray @ np.swapaxes(turn, 1, 2)
    basis = tangents(ray.reshape(-1, 3)).reshape(f, n, 2, 3)
    u = (point.clock[i, 1] * frames.time_s + point.clock[i, 0] - setup.epoch_s) / setup.scale_s
    place, speed, powers = _motion(setup, point, u)
    away = place - (frames.centre_m + point.shift[i])[:, None]
    depth = np.maximum((away * ray).sum(-1), 1.0)
    flat = (basis @ away[..., None])[..., 0]
    error = flat / depth[..., None]
    by_place = (basis - error[..., None] * ray[:, :, None]) / depth[..., None, None]
    by_tilt = basis @ skew(ray) @ frames.axes[:, None]
    by_time = (by_place @ speed[..., None])[..., 0]
    lag = (frames.time_s - setup.middle_s[i])[:, None, None]
    blocks = [by_time[..., None], (by_time * lag)[..., None], by_tilt, -by_place]
    at = 8
    jacobian = np.zeros((f, n, 2, 8 + setup.size - 8 * len(setup.views)))
    jacobian[..., :8] = np.concatenate(blocks, axis=-1)
    for k, phi in enumerate(powers):
        terms = phi.shape[1]
        block = phi[:, None, :, None] * by_place[:, k, :, None, :]
        jacobian[:, k, :, at : at + 3 * terms] = block.reshape(f, 2, 3 * terms)
        at += 3 * terms
    there = np.repeat(frames.present, 2, axis=1)
    tilt = (by_tilt.reshape(f, 2 * n, 3)) * there[..., None]
    shift = (by_place.reshape(f, 2 * n, 3)) * there[..., None]
    own = np.where(there > 0, np.repeat(frames.pixel_rad, 2, axis=1) ** 2, 1.0)
    covariance = own[..., None] * np.eye(2 * n)
    covariance = covariance + view.tilt_noise_rad**2 * tilt @ np.swapaxes(tilt, 1, 2)
    covariance = covariance + view.shift_noise_m**2 * shift @ np.swapaxes(shift, 1, 2)
    residual = error.reshape(f, 2 * n) * there
    return residual, jacobian.reshape(f, 2 * n, -1) * there[..., None], covariance


def _motion(setup: _Setup, point: _Point, u: Floats) -> tuple[Floats, Floats, list[Floats]]:
    """Positions and velocities (f, n, 3) of all targets at scaled times (f,), and the powers (f, K + 1) of each."""
    powers = [u[:, None] ** np.arange(k + 1) for k in setup.orders]
    place = np.stack([phi @ a for phi, a in zip(powers, point.motion, strict=True)], axis=1)
    speed = [
        (phi[:, :-1] * np.arange(1, len(a))) @ a[1:] / setup.scale_s if len(a) > 1 else np.zeros((len(u), 3))
        for phi, a in zip(powers, point.motion, strict=True)
    ]
    return place, np.stack(speed, axis=1), powers


def _priors(setup: _Setup, point: _Point) -> tuple[Floats, Floats, float]:
    """Normal matrix, right-hand side and half chi-square of the priors alone."""
    normal, right, cost = np.zeros((setup.size, setup.size)), np.zeros(setup.size), 0.0
    for i, (view, prior) in enumerate(zip(setup.views, setup.priors, strict=True)):
        at = 8 * i
        weight = np.array([view.tilt_rad**-2] * 3 + [view.shift_m**-2] * 3)
        value = np.concatenate([point.tilt[i], point.shift[i]])
        normal[range(at + 2, at + 8), range(at + 2, at + 8)] = weight
        right[at + 2 : at + 8] = -weight * value
        cost += 0.5 * float((weight * value**2).sum())
        if prior is None:
            normal[at, at] = normal[at + 1, at + 1] = 1e16
            continue
        offset, stretch = point.clock[i]
        cost += prior_cost(prior, float(offset), float(stretch))
        pull = 1 / (prior.stretch_sigma**2 + (stretch - 1) ** 2)
        normal[at + 1, at + 1] = pull
        right[at + 1] = -pull * (stretch - 1)
        if prior.offset_sigma_s is not None:
            row = np.array([1.0, -setup.middle_s[i]]) / prior.offset_sigma_s
            normal[at : at + 2, at : at + 2] += np.outer(row, row)
            right[at : at + 2] -= row * (offset - prior.offset_s) / prior.offset_sigma_s
    return normal, right, cost


def _step(normal: Floats, right: Floats, damping: float) -> Floats:
    diagonal = np.diagonal(normal)
    scale = 1 / np.sqrt(np.maximum(diagonal, 1e-300))
    scaled = normal * scale[:, None] * scale + damping * np.eye(len(normal))
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * right, rcond=1e-13)[0])


def _moved(setup: _Setup, point: _Point, step: Floats) -> _Point:
    own = step[: 8 * len(setup.views)].reshape(-1, 8)
    clock = point.clock.copy()
    clock[:, 1] += own[:, 1]
    clock[:, 0] += own[:, 0] - own[:, 1] * setup.middle_s
    motion, at = [], 8 * len(setup.views)
    for a in point.motion:
        motion.append(a + step[at : at + a.size].reshape(a.shape))
        at += a.size
    return _Point(clock=clock, tilt=point.tilt + own[:, 2:5], shift=point.shift + own[:, 5:], motion=motion)
