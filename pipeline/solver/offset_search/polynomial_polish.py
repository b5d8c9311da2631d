"""Polishing of clocks where every target moves as a polynomial: Levenberg-Marquardt on motions, clocks and biases.

    y = X_n(s_c tau + beta_c) - C - p_c,   d = R exp(w_c) R' d_measured,   e = T' y / (d . y)        (an angle)

The covariance of the residuals of one frame is exact to first order,

    S_f = diag(pixel) + attitude^2 J_w J_w' + position^2 J_p J_p',

so what a frame's own attitude and position errors do to all of its targets at once costs nothing extra, and the angles
between targets count with the pixel's small sigma. Frames whose chi-square is far beyond their size are weighted down.

A motion's unknowns act on a frame through its targets' positions alone, each times a power of time. So the products of
residuals and derivatives are formed for positions, 9 + 3 n columns a frame, and summed times powers of time; every
entry of the normal matrix is one of these sums.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.compiled import is_compiled
from pipeline.geometry.rotation import exp, matrix
from pipeline.solver.observation.symmetric import solved
from pipeline.solver.offset_search._frame_sums import frame_sums
from pipeline.solver.offset_search.crossing import ClockPrior, Hypothesis, clock_scale_pull, prior_cost
from pipeline.solver.offset_search.frame_sets import FrameSet, Whitening, frames_of, whitening
from pipeline.solver.offset_search.polynomial import project_motion, stacked_rows
from pipeline.solver.offset_search.sweep import ClockRange
from pipeline.solver.offset_search.views import View, share_together

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

    @cached_property
    def unknowns(self) -> tuple[Ints, Ints]:
        """Of a camera's unknowns, its own eight and every motion's: the column of `_design`, and the power of time."""
        column, power = [np.arange(1, 9)], [np.zeros(8, np.int64)]
        for n, order in enumerate(self.orders):
            column.append(np.tile(9 + 3 * n + np.arange(3), order + 1))
            power.append(np.repeat(np.arange(order + 1), 3))
        return np.concatenate(column), np.concatenate(power)


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
    """Smallest share, over the cameras, in which some other camera looks too, of the shorter of both spans."""
    spans = [np.array(v.span_s) * c[1] + c[0] for v, c in zip(setup.views, point.clock, strict=True)]
    return min(
        max([0.0, *(float(share_together(one, other)) for j, other in enumerate(spans) if j != i)])
        for i, one in enumerate(spans)
    )


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
    column, power = setup.unknowns
    for i in range(len(setup.frames)):
        sums, half_square = _frame_sums(setup, point, i, held[i].inverse)
        cost += half_square
        columns = _columns(setup, i)
        normal[np.ix_(columns, columns)] += sums[power[:, None] + power, column[:, None], column]
        right[columns] -= sums[power, column, 0]
    return normal, right, cost


def _frame_sums(setup: _Setup, point: _Point, i: int, inverse: Floats) -> tuple[Floats, float]:
    """`frame_sums_plain`, compiled where it can be."""
    if not is_compiled(frame_sums.__module__):
        return frame_sums_plain(setup, point, i, inverse)
    frames = setup.frames[i]
    found: tuple[Floats, float] = frame_sums(
        frames.time_s, frames.present, frames.centre_m, frames.axes, frames.camera_ray, frames.camera_across,
        frames.by_tilt, inverse, point.clock[i], float(setup.middle_s[i]), matrix(exp(point.attitude_bias[i])),
        point.position_bias[i], _stacked(setup, point).reshape(max(setup.orders) + 1, -1, 3), setup.epoch_s,
        setup.scale_s,
    )  # fmt: skip
    return found


def frame_sums_plain(setup: _Setup, point: _Point, i: int, inverse: Floats) -> tuple[Floats, float]:
    """Products of residuals and derivatives of camera `i`, weighted, summed times powers 0 to 2 K of scaled time
    (2 K + 1, 9 + 3 n, 9 + 3 n), and its half chi-square; `inverse` (f, 2 n, 2 n) whitens."""
    frames = setup.frames[i]
    white = inverse @ _design(setup, point, i, frames)
    square = (white[..., 0] ** 2).sum(1)
    size = 2 * frames.present.sum(1)
    limit = size + 6 * np.sqrt(2 * size) + 1e-9
    weight = np.minimum(1.0, limit / np.maximum(square, 1e-30))
    cost = 0.5 * float(np.where(square <= limit, square, limit * (1 + np.log(square / limit + 1e-30))).sum())
    products = np.swapaxes(white, 1, 2) @ white
    powers = _powers(setup, point, i, frames, 2 * max(setup.orders)) * weight
    return (powers @ products.reshape(len(products), -1)).reshape(-1, *products.shape[1:]), cost


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


def _sightings(setup: _Setup, point: _Point, i: int, frames: FrameSet) -> tuple[Floats, Floats]:
    """Vectors camera to target (f, n, 3) in axes of the camera as turned by its bias, and depths (f, n)."""
    powers = _powers(setup, point, i, frames, max(setup.orders))
    place = (powers.T @ _stacked(setup, point)).reshape(len(frames.time_s), -1, 3)
    away = (place - (frames.centre_m + point.position_bias[i])[:, None]) @ frames.axes
    turned = away @ matrix(exp(point.attitude_bias[i]))
    return turned, np.einsum("fnx,fnx->fn", turned, frames.camera_ray)


def _stacked(setup: _Setup, point: _Point) -> Floats:
    """Coefficients (K + 1, 3 n) of all motions, those of lower order filled up with zeros."""
    out = np.zeros((max(setup.orders) + 1, len(setup.orders), 3))
    for n, a in enumerate(point.motion):
        out[: len(a), n] = a
    return out.reshape(len(out), -1)


def _powers(setup: _Setup, point: _Point, i: int, frames: FrameSet, highest: int) -> Floats:
    """Powers 0 to `highest` (highest + 1, f) of scaled common time."""
    u = (point.clock[i, 1] * frames.time_s + point.clock[i, 0] - setup.epoch_s) / setup.scale_s
    out = np.ones((highest + 1, len(u)))
    for k in range(highest):
        out[k + 1] = out[k] * u
    return out


def _design(setup: _Setup, point: _Point, i: int, frames: FrameSet) -> Floats:
    """Residuals and derivatives (f, 2 n, 1 + 8 + 3 n) of one camera's frames: by its clock, its biases, and the
    positions of the targets; zero where nothing was seen."""
    f, n = frames.present.shape
    turned, depth = _sightings(setup, point, i, frames)
    depth = np.maximum(depth, 1.0)
    seen = frames.present / depth
    error = (frames.camera_across @ turned[..., None])[..., 0] / depth[..., None]
    to_camera = (frames.camera_across - error[..., None] * frames.camera_ray[:, :, None]) * seen[..., None, None]
    turn = matrix(exp(point.attitude_bias[i])).T
    by_place = ((to_camera.reshape(f, 2 * n, 3) @ turn) @ np.swapaxes(frames.axes, 1, 2)).reshape(f, n, 2, 3)
    powers = _powers(setup, point, i, frames, max(setup.orders))
    rates = powers[:-1].T * np.arange(1, len(powers))
    speed = (rates @ _stacked(setup, point)[1:] / setup.scale_s).reshape(f, n, 3)
    by_time = (by_place @ speed[..., None])[..., 0]
    lag = (frames.time_s - setup.middle_s[i])[:, None, None]
    design = np.zeros((f, n, 2, 9 + 3 * n))
    design[..., 0] = error * frames.present[..., None]
    design[..., 1] = by_time
    design[..., 2] = by_time * lag
    design[..., 3:6] = frames.by_tilt @ turn * frames.present[..., None, None]
    design[..., 6:9] = -by_place
    for k in range(n):
        design[:, k, :, 9 + 3 * k : 12 + 3 * k] = by_place[:, k]
    return design.reshape(f, 2 * n, -1)


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
    return np.asarray(scale * solved(scaled, (scale * right)[:, None])[:, 0])


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
