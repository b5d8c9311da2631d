"""Polishing of clocks where every target moves as a polynomial: Levenberg-Marquardt on motions, clocks and biases.

    y = X_n(s_c tau + beta_c) - C - p_c,   d = R exp(w_c) R' d_measured,   e = T' y / (d . y)        (an angle)

The covariance of the residuals of one frame is exact to first order,

    S_f = diag(pixel) + attitude^2 J_w J_w' + position^2 J_p J_p',

so what a frame's own attitude and position errors do to all of its targets at once costs nothing extra, and the angles
between targets count with the pixel's small sigma. Frames whose chi-square is far beyond their size are weighted down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry.rotation import exp, matrix, skew
from pipeline.solver.offset_search.crossing import ClockPrior, Hypothesis, clock_scale_pull, prior_cost
from pipeline.solver.offset_search.frame_sets import FrameSet, Whitening, frames_of, whitening
from pipeline.solver.offset_search.polynomial import project_motion, stacked_rows
from pipeline.solver.offset_search.sweep import ClockRange
from pipeline.solver.offset_search.views import View

FRAMES = 500
"""Frames of all cameras together that are adjusted, at least sixty of each."""
ITERATIONS = 12
ROUNDS = 3
"""How often the covariances are taken anew: they depend on how far the targets are."""
EXTRAPOLATED = 12.5
"""Half chi-square, in units of weight, that a clock without any overlap must win by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Point:
    """Where the adjustment stands: clock (c, 2), biases (c, 3) each, coefficients (K + 1, 3) per target."""

    clock: Floats
    attitude_bias: Floats
    position_bias: Floats
    motion: list[Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Setup:
    """What stays while the adjustment moves."""

    views: Sequence[View]
    priors: Sequence[ClockPrior | None]
    frames: Sequence[FrameSet]
    middle_s: Floats
    orders: Sequence[int]
    epoch_s: float
    scale_s: float

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
) -> Hypothesis:
    """The clocks of `views` moved downhill from `clocks`, for targets of known polynomial order.

    `effort` is the share of the frames that is used.
    """
    wanted = [t for t in orders if any(t in v.tracks for v in views)]
    setup, point = _start(views, np.array(clocks, float), priors, wanted, orders, effort)
    for _ in range(ROUNDS):
        held = _held(setup, point)
        point, moved_s = _downhill(setup, point, held)
        if moved_s < 1e-3:
            break
    held = _held(setup, point)
    normal, _, cost = _normal(setup, point, held)
    fit = _fit(setup, point, cost + sum(w.widening for w in held), normal)
    return replace(fit, misfit=_misfit(setup, point, held))


def polynomial_information(
    views: Sequence[View], clocks: Sequence[tuple[float, float]], orders: Mapping[str, int]
) -> Floats:
    """What the sightings alone know (8 c, 8 c) of every camera: time at mid-track, clock scale, biases (6).

    The motions, of known polynomial order, are eliminated; they are taken where they fit best at the given clocks.
    """
    wanted = [t for t in orders if any(t in v.tracks for v in views)]
    free = ClockPrior(clock_scale_sigma=1e6, allowed=ClockRange(low_s=0.0, high_s=0.0, clock_scale=1.0))
    setup, point = _start(views, np.array(clocks, float), [free] * len(views), wanted, orders, 1.0)
    normal = _normal(setup, point, _held(setup, point))[0] - _priors(setup, point)[0]
    size = 8 * len(views)
    motion = normal[size:, size:]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(motion), 1e-300))
    inverse = np.linalg.pinv(motion * scale[:, None] * scale, rcond=1e-12, hermitian=True)
    coupling = normal[:size, size:] * scale
    return np.asarray(normal[:size, :size] - coupling @ inverse @ coupling.T)


def _held(setup: _Setup, point: _Point) -> list[Whitening]:
    """The frames' covariances at the distances of `point`."""
    return [
        whitening(setup.views[i], f, np.maximum(_sightings(setup, point, i, f)[1], 1.0))
        for i, f in enumerate(setup.frames)
    ]


def _downhill(setup: _Setup, point: _Point, held: Sequence[Whitening]) -> tuple[_Point, float]:
    """Levenberg-Marquardt with the covariances held; also how far any clock went."""
    first = point.clock[:, 0] + point.clock[:, 1] * setup.middle_s
    normal, right, cost = _normal(setup, point, held)
    damping = 1e-3
    for _ in range(ITERATIONS):
        trial = _moved(setup, point, _step(normal, right, damping))
        new = _normal(setup, trial, held)
        if not new[2] < cost:
            damping *= 10
            if damping > 1e3:
                break
            continue
        gained, (normal, right, cost), point = cost - new[2], new, trial
        damping = max(damping / 10, 1e-9)
        if gained < 1e-3:
            break
    return point, float(np.abs(point.clock[:, 0] + point.clock[:, 1] * setup.middle_s - first).max())


def _fit(setup: _Setup, point: _Point, cost: float, normal: Floats) -> Hypothesis:
    overlap = _overlap(setup, point)
    names = [v.camera for v in setup.views]
    equations = 2 * sum(float(f.present.sum()) for f in setup.frames)
    sigma = _sigmas(normal)[: 8 * len(names) : 8]
    unit = max(1.0, 2 * cost / max(equations, 1.0))
    return Hypothesis(
        clock={n: (float(c[0]), float(c[1])) for n, c in zip(names, point.clock, strict=True)},
        cost=cost if overlap > 0 else cost + EXTRAPOLATED * unit,
        overlap=max(overlap, 1e-9),
        sigma_s=dict(zip(names, (float(x) for x in sigma), strict=True)),
        attitude_bias_rad=dict(zip(names, point.attitude_bias, strict=True)),
        position_bias_m=dict(zip(names, point.position_bias, strict=True)),
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
    frames = [frames_of(v, targets, each) for v in views]
    setup = _Setup(
        views=views,
        priors=priors,
        frames=frames,
        middle_s=np.array([0.5 * sum(v.span_s) for v in views]),
        orders=[orders[t] for t in targets],
        epoch_s=float(linear.epoch_s[0]),
        scale_s=float(linear.scale_s[0]),
    )
    bias = linear.bias[0].reshape(len(views), 2, 3)
    motion = [a[0] for a in linear.coefficients]
    return setup, _Point(clock=clocks, attitude_bias=bias[:, 0], position_bias=bias[:, 1], motion=motion)


def _normal(setup: _Setup, point: _Point, held: Sequence[Whitening]) -> tuple[Floats, Floats, float]:
    """Normal matrix, right-hand side and half chi-square, priors included."""
    normal, right, cost = _priors(setup, point)
    for i, frames in enumerate(setup.frames):
        design = _design(setup, point, i, frames)
        white = held[i].inverse @ design
        square = (white[..., 0] ** 2).sum(1)
        size = 2 * frames.present.sum(1)
        limit = size + 6 * np.sqrt(2 * size) + 1e-9
        weight = np.minimum(1.0, limit / np.maximum(square, 1e-30))
        cost += 0.5 * float(np.where(square <= limit, square, limit * (1 + np.log(square / limit + 1e-30))).sum())
        flat = (white * np.sqrt(weight)[:, None, None]).reshape(-1, white.shape[2])
        columns = _columns(setup, i)
        gram = flat.T @ flat
        normal[np.ix_(columns, columns)] += gram[1:, 1:]
        right[columns] -= gram[1:, 0]
    return normal, right, cost


def _misfit(setup: _Setup, point: _Point, held: Sequence[Whitening]) -> float:
    """Chi-square per equation of the median frame of the worst camera."""
    worst = 0.0
    for i, frames in enumerate(setup.frames):
        white = held[i].inverse @ _design(setup, point, i, frames)[..., :1]
        ratio = (white[..., 0] ** 2).sum(1) / np.maximum(2 * frames.present.sum(1), 1)
        worst = max(worst, float(np.median(ratio)))
    return worst


def _columns(setup: _Setup, camera: int) -> Ints:
    """Unknowns that a camera's frames touch: its own eight, then every motion."""
    motions = np.arange(8 * len(setup.views), setup.size)
    return np.concatenate([8 * camera + np.arange(8), motions])


def _sightings(setup: _Setup, point: _Point, i: int, frames: FrameSet) -> tuple[Floats, Floats, Floats, Floats]:
    """Vectors camera to target (f, n, 3), depths (f, n), turned rays (f, n, 3) and vectors across (f, n, 2, 3)."""
    turn = np.swapaxes(frames.axes @ matrix(exp(point.attitude_bias[i])) @ np.swapaxes(frames.axes, 1, 2), 1, 2)
    ray = frames.ray @ turn
    place = np.stack([phi @ a for phi, a in zip(_powers(setup, point, i, frames), point.motion, strict=True)], axis=1)
    away = place - (frames.centre_m + point.position_bias[i])[:, None]
    return away, np.asarray((away * ray).sum(-1)), ray, frames.across @ turn[:, None]


def _powers(setup: _Setup, point: _Point, i: int, frames: FrameSet) -> list[Floats]:
    """Powers (f, K + 1) of scaled common time, per target."""
    u = (point.clock[i, 1] * frames.time_s + point.clock[i, 0] - setup.epoch_s) / setup.scale_s
    return [u[:, None] ** np.arange(k + 1) for k in setup.orders]


def _design(setup: _Setup, point: _Point, i: int, frames: FrameSet) -> Floats:
    """Residuals and Jacobian (f, 2 n, 1 + 8 + motions) of one camera's frames; zero where nothing was seen."""
    f, n = frames.present.shape
    away, depth, ray, basis = _sightings(setup, point, i, frames)
    depth = np.maximum(depth, 1.0)
    error = (basis @ away[..., None])[..., 0] / depth[..., None]
    by_place = (basis - error[..., None] * ray[:, :, None]) / depth[..., None, None]
    powers = _powers(setup, point, i, frames)
    speed = np.stack([_speed(phi, a, setup.scale_s) for phi, a in zip(powers, point.motion, strict=True)], axis=1)
    by_time = by_place @ speed[..., None]
    lag = (frames.time_s - setup.middle_s[i])[:, None, None, None]
    by_tilt = basis @ skew(ray) @ frames.axes[:, None]
    design = np.zeros((f, n, 2, 9 + setup.size - 8 * len(setup.views)))
    design[..., :9] = np.concatenate([error[..., None], by_time, by_time * lag, by_tilt, -by_place], axis=-1)
    at = 9
    for k, phi in enumerate(powers):
        block = phi[:, None, :, None] * by_place[:, k, :, None, :]
        design[:, k, :, at : at + 3 * phi.shape[1]] = block.reshape(f, 2, -1)
        at += 3 * phi.shape[1]
    return np.asarray((design * frames.present[..., None, None]).reshape(f, 2 * n, -1))


def _speed(powers: Floats, motion: Floats, scale_s: float) -> Floats:
    """Velocity (f, 3) of a target."""
    return np.asarray((powers[:, :-1] * np.arange(1, len(motion))) @ motion[1:] / scale_s)


def _priors(setup: _Setup, point: _Point) -> tuple[Floats, Floats, float]:
    """Normal matrix, right-hand side and half chi-square of the priors alone."""
    normal, right, cost = np.zeros((setup.size, setup.size)), np.zeros(setup.size), 0.0
    for i, (view, prior) in enumerate(zip(setup.views, setup.priors, strict=True)):
        at = 8 * i
        weight = np.array([view.attitude_bias_rad**-2] * 3 + [view.position_bias_m**-2] * 3)
        value = np.concatenate([point.attitude_bias[i], point.position_bias[i]])
        normal[range(at + 2, at + 8), range(at + 2, at + 8)] = weight
        right[at + 2 : at + 8] = -weight * value
        cost += 0.5 * float((weight * value**2).sum())
        if prior is None:
            normal[at, at] = normal[at + 1, at + 1] = 1e16
            continue
        offset, clock_scale = point.clock[i]
        cost += prior_cost(prior, float(offset), float(clock_scale))
        normal[at + 1, at + 1], slope = clock_scale_pull(prior, float(clock_scale))
        right[at + 1] = -slope
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


def _sigmas(normal: Floats) -> Floats:
    """One sigma of every unknown."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    covariance = np.linalg.pinv(normal * scale[:, None] * scale, rcond=1e-13, hermitian=True)
    return np.asarray(scale * np.sqrt(np.abs(np.diagonal(covariance))))


def _moved(setup: _Setup, point: _Point, step: Floats) -> _Point:
    own = step[: 8 * len(setup.views)].reshape(-1, 8)
    clock = point.clock.copy()
    clock[:, 1] += own[:, 1]
    clock[:, 0] += own[:, 0] - own[:, 1] * setup.middle_s
    motion, at = [], 8 * len(setup.views)
    for a in point.motion:
        motion.append(a + step[at : at + a.size].reshape(a.shape))
        at += a.size
    return _Point(
        clock=clock,
        attitude_bias=point.attitude_bias + own[:, 2:5],
        position_bias=point.position_bias + own[:, 5:],
        motion=motion,
    )
