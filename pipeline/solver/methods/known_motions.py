"""From the records to the rows of `KnownMotion`: landmarks' places, and targets held against the ground where they go.

A target's way over the ground, from which its rows take their times and knots, comes from its sight rays: each is
followed until it meets the ground (`ray_ground.py`). Once the motion is adjusted, rows are made anew along it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import GeometryError
from pipeline.records import Finding, Ground, Problem, TargetInput
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.ray_ground import Way, way_on_ground
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.known_motion import NO_SHARED, KnownMotion
from pipeline.solver.observation.motion_basis import MotionBasis, TargetBasis
from pipeline.solver.observation.observations import Frames

ROW_S, MOST_ROWS = 0.1, 1200
"""Time between the rows of a target on the ground, a third of that between splines' knots, so that none can swing
between rows; and how many it has at most."""
SMOOTH_S = 0.8
"""Standard deviation in time of the mean over the ground along a way. Bumps that pass in a second are gone, of those
that pass in four seconds half is left, about what a spline of white jerk follows. With half as much, hills bend it."""
ROW_M = 0.17
"""Metres, of every row: springs, stones, what a smooth motion does otherwise than a mean of the ground."""
MOST_KNOTS = 40
"""Of the roughness along one target's way: beyond, it is alike for longer than a cell."""
COMMON = -2
"""In place of a number: the ground's common error."""
ALIKE = 3.5
"""Length of a mean, in its standard deviations: what it takes away is alike within."""
BEFORE_AFTER_S: Floats = SMOOTH_S * np.linspace(-2, 2, 9)
WEIGHT: Floats = np.exp(-0.5 * np.linspace(-2, 2, 9) ** 2) / np.exp(-0.5 * np.linspace(-2, 2, 9) ** 2).sum()
UNEVEN = 0.02
"""Root mean square slope along a way from which on a single camera's distances are not believed."""
SAMPLES = 4
"""Places for every coefficient, where a motion is laid through a way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rows:
    """Of one target; `shared` counts its own errors from 0, whose priors are `sigmas_m`; see `KnownMotion`."""

    target: int
    time_s: Floats
    sigma_m: Floats
    axis: Ints
    level_m: Floats
    around_m: Floats
    shared: Ints
    share: Floats
    sigmas_m: Floats


def first_known(problem: Problem, frames: Frames, time_s: Floats) -> tuple[KnownMotion | None, dict[int, Way]]:
    """What is known at the start, and the ways of targets on the ground; `time_s` (F,) are common times.

    Raises GeometryError where a target's ground is not known, or its rays do not meet it.
    """
    rows, ways = _placed(problem), {}
    for n, target in enumerate(problem.targets):
        if target.on_ground and problem.ground is not None:
            way = way_on_ground(problem, problem.ground, frames, n, time_s)
            when = _times(float(way.time_s[0]), float(way.time_s[-1]))
            rows.append(_on_ground(problem.ground, target, n, when, way.at))
            ways[n] = way
    return _joined(problem, rows), ways


def renewed_known(problem: Problem, model: Model, state: State) -> Model:
    """The model with the ground's rows made anew along the motions as they are now."""
    if problem.ground is None or model.known is None or not (model.known.axis < 0).any():
        return model
    time = common_time_s(model.frames, model.drift, state.camera, state.deviation)
    rows = _placed(problem)
    for n, target in enumerate(problem.targets):
        if target.on_ground:
            own = time[model.frames.seen[:, n]]
            when = _times(float(own.min()), float(own.max()))
            ends = float(own.min()), float(own.max())

            def at(time_s: Floats, n: int = n, ends: tuple[float, float] = ends) -> Floats:
                return np.asarray(model.basis.position(np.clip(time_s, *ends), state.coefficients)[:, n])

            rows.append(_on_ground(problem.ground, target, n, when, at))
    return replace(model, known=_joined(problem, rows))


def _times(low_s: float, high_s: float) -> Floats:
    count = int(np.clip(np.ceil((high_s - low_s) / ROW_S), 1, MOST_ROWS))
    return low_s + (high_s - low_s) * (np.arange(count) + 0.5) / count


def _placed(problem: Problem) -> list[_Rows]:
    """Three rows for every surveyed landmark."""
    return [
        _Rows(
            target=n, time_s=np.zeros(3), sigma_m=np.array(t.surveyed.sigma_m), axis=np.arange(3),
            level_m=np.array(t.surveyed.position_enu_m), around_m=np.zeros((3, len(WEIGHT), 2)),
            shared=np.tile(NO_SHARED, (3, 1)),
            share=np.zeros((3, len(NO_SHARED))), sigmas_m=np.zeros(0),
        )
        for n, t in enumerate(problem.targets)
        if t.surveyed is not None and not t.check
    ]  # fmt: skip


def _on_ground(ground: Ground, target: TargetInput, n: int, time_s: Floats, way: Callable[[Floats], Floats]) -> _Rows:
    """Rows along a way, times (k,) -> (k, 3)."""
    place, count = way(time_s)[:, :2], len(time_s)
    around = np.stack([way(time_s + step)[:, :2] - place for step in BEFORE_AFTER_S], axis=1)
    found = ground.at((place[:, None] + around).reshape(-1, 2))
    up, rough = found.up_m.reshape(count, -1), found.rough_m.reshape(count, -1)
    good = found.known.reshape(count, -1).all(axis=1)
    if not good.any():
        raise _unknown_ground(target, ground, place)
    way_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    alike_m = max(ground.cell_m, ALIKE * SMOOTH_S * way_m[-1] / max(float(np.ptp(time_s)), SMOOTH_S))
    taken = (up[:, len(WEIGHT) // 2] - up @ WEIGHT) ** 2
    sigma = np.sqrt((rough**2) @ WEIGHT + np.convolve(np.pad(taken, 3, mode="edge"), np.full(7, 1 / 7), "valid"))
    knots = 1 + int(np.clip(np.ceil(way_m[-1] / alike_m), 0, MOST_KNOTS))
    at = way_m / max(way_m[-1], 1e-9) * (knots - 1)
    left = np.minimum(at.astype(int), max(knots - 2, 0))
    right = np.minimum(left + 1, knots - 1)
    shared = np.column_stack([np.full(count, COMMON), np.zeros(count, dtype=int), 1 + left, 1 + right])
    share = np.column_stack([np.ones((count, 2)), 1 - (at - left), np.where(knots > 1, at - left, 0.0)])
    knot_sigma = np.interp(np.arange(knots), at, sigma) if count > 1 and knots > 1 else np.full(knots, sigma.mean())
    return _Rows(
        target=n, time_s=time_s[good], sigma_m=np.full(int(good.sum()), ROW_M), around_m=around[good],
        axis=np.full(int(good.sum()), -1), level_m=np.full(int(good.sum()), target.above_ground_m),
        shared=shared[good], share=share[good], sigmas_m=np.concatenate([[ground.own_m], knot_sigma]),
    )  # fmt: skip


def _unknown_ground(target: TargetInput, ground: Ground, place_m: Floats) -> GeometryError:
    east, north = np.median(place_m, axis=0)
    return GeometryError(
        where=f"target {target.target}",
        seen=f"it is on the ground about {east:.0f} m east, {north:.0f} m north of the origin, where {ground.source} "
        "has no height",
        expected="a ground whose height is known where its targets are",
        advice="take a terrain model that covers the place, or leave on_ground out",
    )


def _joined(problem: Problem, rows: list[_Rows]) -> KnownMotion | None:
    """All rows, their ground errors numbered: the common one first, then each target's own and its knots'."""
    if not rows:
        return None
    ground = problem.ground
    sigmas, shared = [np.zeros(0) if ground is None else np.array([ground.common_m])], []
    for r in rows:
        first = sum(len(s) for s in sigmas)
        shared.append(np.where(r.shared == COMMON, 0, np.where(r.shared >= 0, r.shared + first, -1)))
        sigmas.append(r.sigmas_m)
    sigma, every = np.concatenate(sigmas), np.concatenate(shared)
    every = np.where((every >= 0) & (np.append(sigma, 0.0)[every] > 0), every, -1)
    used = np.unique(every[every >= 0])
    return KnownMotion(
        target=np.concatenate([np.full(len(r.time_s), r.target) for r in rows]),
        time_s=np.concatenate([r.time_s for r in rows]),
        sigma_m=np.concatenate([r.sigma_m for r in rows]),
        axis=np.concatenate([r.axis for r in rows]),
        level_m=np.concatenate([r.level_m for r in rows]),
        around_m=np.concatenate([r.around_m for r in rows]),
        weight=WEIGHT,
        shared=np.where(every >= 0, np.searchsorted(used, every), -1),
        share=np.concatenate([r.share for r in rows]),
        shared_sigma_m=sigma[used] if len(used) else np.zeros(0),
        ground=None if ground is None else ground.at,
    )


def laid_through(basis: MotionBasis, coefficients: Floats, ways: dict[int, Way], problem: Problem) -> Floats:
    """Coefficients (P, 3) with the motions of targets on the ground laid through their ways, landmarks at theirs."""
    out = coefficients.copy()
    for n, t in enumerate(problem.targets):
        own = basis.targets[n]
        if t.surveyed is not None:
            out[own.first] = t.surveyed.position_enu_m
        if n in ways:
            low, high = max(own.knots_s[0], ways[n].time_s[0]), min(own.knots_s[-1], ways[n].time_s[-1])
            time = np.linspace(low, max(high, low + 1e-6), SAMPLES * own.count + 8)
            wanted = ways[n].at(time)
            matrix = np.concatenate([_values(basis, own, time), _smooth(own)])
            right = np.concatenate([wanted, np.zeros((len(matrix) - len(time), 3))])
            out[own.first : own.first + own.count] = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return out


def _values(basis: MotionBasis, t: TargetBasis, time_s: Floats) -> Floats:
    """(n, count): what each coefficient adds to the place at `time_s`."""
    span = basis.span(time_s)
    u = (time_s - basis.mid_s[span]) / basis.half_s[span]
    value = np.einsum("bij,bi->bj", t.transform[span], u[:, None] ** np.arange(basis.degree + 1))
    out = np.zeros((len(time_s), t.count))
    out[np.arange(len(time_s))[:, None], t.active[span][:, None] - t.first + np.arange(t.degree + 1)] = value
    return out


def _smooth(t: TargetBasis) -> Floats:
    """Rows that keep a spline's coefficients even where its way says nothing of them."""
    return 0.1 * np.diff(np.eye(t.count), n=2, axis=0) if t.kind == "spline" else np.zeros((0, t.count))


def ground_gaps(problem: Problem, model: Model, state: State) -> tuple[Finding, ...]:
    """Findings about targets on the ground: where it is not known, or too uneven for a single camera."""
    if problem.ground is None or model.known is None:
        return ()
    out, frames = [], model.frames
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    for n, target in enumerate(problem.targets):
        if not target.on_ground:
            continue
        rows = np.flatnonzero(frames.seen[:, n])
        place = model.basis.position(time[rows], state.coefficients)[:, n]
        found = problem.ground.at(place[:, :2])
        steep = float(np.sqrt((found.slope**2).sum(axis=1).mean()))
        if len(np.unique(frames.camera[rows])) == 1 and steep > UNEVEN:
            words = f"{target.target} is seen by one camera alone, over ground of {100 * steep:.0f} % slope: there its"
            words += " distance has been found several of its sigmas off"
            out.append(Finding(kind="uneven-ground", subject=target.target, words=words))
        missing = ~found.known
        if missing.any():
            where = "; ".join(_stretches(frames, rows[missing]))
            words = f"{target.target} is where {problem.ground.source} has no height ({where}): only sight rays and "
            words += "its motion before and after hold it there"
            out.append(Finding(kind="ground-gap", subject=target.target, words=words, carried_by="ground.terrain"))
    return tuple(out)


def _stretches(frames: Frames, rows: Ints) -> list[str]:
    out = []
    for c, name in enumerate(frames.cameras):
        own = frames.frame[rows[frames.camera[rows] == c]]
        if len(own):
            out.append(f"{name} frames {own[0]} to {own[-1]}" if len(own) > 1 else f"{name} frame {own[0]}")
    return out
