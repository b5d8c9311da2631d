"""Distances that are so unsure that a symmetric sigma misleads, with an interval that holds.

What sight rays measure is the parallax, base line over distance, and its error is nearly normal; so the distance r has
a normal inverse. With the sigma s of r linearised where the answer is, 1/r has the sigma s/r^2, and

    r in [1 / (1/r + z s/r^2), 1 / (1/r - z s/r^2)]

which is short before the target and long behind it, and open where the parallax may be zero.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import DepthRange, Motion, Solution
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.observation.clocks import common_time_s

WITHIN_68, WITHIN_95 = 0.99446, 1.95996
"""Normal deviates of 68 and 95 %."""


def depth_ranges(model: Model, state: State, solution: Solution, share: float) -> tuple[DepthRange, ...]:
    """Of every target whose sigma exceeds `share` of its distance from the camera that sees it most."""
    moving = {m.target for m in solution.motions}
    found = (_of_target(model, state, solution, n) for n, name in enumerate(model.frames.targets) if name in moving)
    return tuple(one for one in found if one is not None and not one.sigma_m <= share * one.depth_m)


def _of_target(model: Model, state: State, solution: Solution, n: int) -> DepthRange | None:
    frames = model.frames
    rows = np.flatnonzero(frames.seen[:, n])
    if len(rows) == 0:
        return None
    c = int(np.bincount(frames.camera[rows]).argmax())
    own = rows[frames.camera[rows] == c]
    at = own[len(own) // 2]
    time = common_time_s(frames, model.drift, state.camera, state.deviation)[at : at + 1]
    station = frames.position_m[at] + state.camera[c, 3:6] + model.pose.spread[c, 3:] * state.own[at, 3:]
    away = solution.motion(frames.targets[n]).position_enu_m(time)[0] - station
    depth = float(np.linalg.norm(away))
    ray = away / max(depth, 1e-9)
    plain = solution.motion(frames.targets[n])
    robust = next((m for m in solution.motions_robust if m.target == plain.target), plain)
    sigma = max(_along(plain, time, ray), _along(robust, time, ray))
    if not np.isfinite(sigma):
        return None
    return DepthRange(
        target=frames.targets[n], camera=frames.cameras[c], time_s=float(time[0]), depth_m=depth, sigma_m=sigma,
        within_68_m=interval(depth, sigma, WITHIN_68), within_95_m=interval(depth, sigma, WITHIN_95),
    )  # fmt: skip


def _along(motion: Motion, time_s: Floats, ray: Floats) -> float:
    return float(np.sqrt(max(float(ray @ motion.position_covariance(time_s)[0] @ ray), 0.0)))


def interval(depth_m: float, sigma_m: float, z: float) -> tuple[float, float]:
    """The distances whose inverse is within `z` sigmas of the inverse found."""
    parallax, spread = 1 / depth_m, z * sigma_m / depth_m**2
    return 1 / (parallax + spread), float("inf") if spread >= parallax else 1 / (parallax - spread)
