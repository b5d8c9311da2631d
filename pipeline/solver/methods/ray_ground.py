"""Where sight rays meet the ground, and the way of a target that comes of it.

A ray is followed in even steps of the distance at which level ground would end it, until it is below the ground; the
place is found by halving. The error of the distance r is s / sin(g) times an angle's error, g the angle between ray and
ground: rays that graze the ground say little, and where the attitude's error is as large as g, nothing at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import Ground, Problem
from pipeline.solver.observation.observations import Frames

LOOKED_AT = 200
"""Rays of one camera that are followed."""
STEPS, FARTHEST, HALVINGS = 96, 4.0, 40
"""Steps of a ray, the share of the level distance at which it is given up, and halvings of a step: micrometres."""
LEVEL = 0.01
"""Least sine of a ray's dip that a level distance is taken from: nearer to the horizon, at a hundred heights."""
GRAZING = 2.0
"""Sigmas of attitude (bias and moving part) that the angle between ray and ground must exceed in the median: below, the
distance has no upper end at 95 %."""
BINS = 20
"""Pieces of a way, each the weighted mean of its rays: the attitude's noise must not lengthen it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """Where a target went: common times (k,) increasing and places (k, 3)."""

    time_s: Floats
    place_m: Floats

    def at(self, time_s: Floats) -> Floats:
        """Places (n, 3), straight between those known."""
        return np.stack([np.interp(time_s, self.time_s, self.place_m[:, i]) for i in range(3)], axis=1)


def meet_ground(ground: Ground, above_m: float, centre_m: Floats, ray: Floats) -> tuple[Floats, Floats, Bools]:
    """Places (m, 3) where rays (m, 3) from (m, 3) meet the ground raised by `above_m`, sines (m,) of the angles there.

    The mask (m,) says which do.
    """
    nadir = ground.at(centre_m[:, :2]).up_m + above_m
    level = np.maximum(centre_m[:, 2] - nadir, 1.0) / np.maximum(-ray[:, 2], LEVEL)
    share = np.linspace(0.0, FARTHEST, STEPS + 1)[1:]
    points = centre_m[:, None] + (level[:, None] * share)[..., None] * ray[:, None]
    under = points[..., 2] <= ground.at(points[..., :2].reshape(-1, 2)).up_m.reshape(points.shape[:2]) + above_m
    meets = under.any(axis=1)
    step = under.argmax(axis=1)
    low, high = level * np.where(step > 0, share[step - 1], 0.0), level * share[step]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        point = centre_m + middle[:, None] * ray
        below = point[:, 2] <= ground.at(point[:, :2]).up_m + above_m
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    place = centre_m + high[:, None] * ray
    slope = ground.at(place[:, :2]).slope
    normal = np.concatenate([-slope, np.ones((len(slope), 1))], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return place, -(ray * normal).sum(axis=1), np.asarray(meets)


def way_on_ground(problem: Problem, ground: Ground, frames: Frames, n: int, time_s: Floats) -> Way:
    """The way of target `n` on the ground, by the cameras' poses as measured. Raises GeometryError."""
    places, times, weights, seen = [], [], [], []
    target = problem.targets[n]
    for c, camera in enumerate(problem.cameras):
        rows = np.flatnonzero(frames.seen[frames.of(c), n]) + int(frames.first[c])
        if not len(rows):
            continue
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), LOOKED_AT)).astype(np.int64))]
        turn, centre = frames.cam_from_enu[rows], frames.position_m[rows]
        ray = np.einsum("fij,fi->fj", turn, frames.ray[rows, n])
        place, sine, meets = meet_ground(ground, target.above_ground_m, centre, ray)
        sigma = float(np.hypot(camera.sigma.attitude_bias_rad, camera.sigma.attitude_rad)) + 1e-4
        usable = meets & (sine > GRAZING * sigma)
        seen.append((camera.camera, float(np.degrees(np.median(np.arcsin(np.clip(sine, -1, 1))))), sigma))
        if usable.sum() * 2 >= len(rows):
            distance = np.linalg.norm(place - centre, axis=1)
            places.append(place[usable])
            times.append(time_s[rows[usable]])
            weights.append((sine / np.maximum(distance, 1.0) / sigma)[usable] ** 2)
    if not places:
        raise _grazing(target.target, seen)
    return _binned(np.concatenate(times), np.concatenate(places), np.concatenate(weights))


def _binned(time_s: Floats, place_m: Floats, weight: Floats) -> Way:
    span = float(np.ptp(time_s))
    bins = np.minimum(((time_s - time_s.min()) / max(span, 1e-9) * BINS).astype(np.int64), BINS - 1)
    known, bins = np.unique(bins, return_inverse=True)
    total = np.bincount(bins, weight)
    time = np.bincount(bins, weight * time_s) / total
    place = np.stack([np.bincount(bins, weight * place_m[:, i]) / total for i in range(3)], axis=1)
    if len(known) == 1:
        return Way(time_s=np.array([time_s.min(), time_s.max() + 1e-6]), place_m=np.repeat(place, 2, axis=0))
    ends = np.array([time_s.min(), time_s.max()])
    first = place[0] + (place[1] - place[0]) * (ends[0] - time[0]) / (time[1] - time[0])
    last = place[-1] + (place[-1] - place[-2]) * (ends[1] - time[-1]) / (time[-1] - time[-2])
    at = np.concatenate([ends[:1] - 1e-9, time, ends[1:] + 1e-9])
    return Way(time_s=at, place_m=np.concatenate([first[None], place, last[None]]))


def _grazing(target: str, seen: list[tuple[str, float, float]]) -> GeometryError:
    told = "; ".join(
        f"{name} looks {'up from' if angle < 0 else 'down on'} the ground there by {abs(angle):.1f} degrees, with an "
        f"attitude good to {np.degrees(sigma):.1f}"
        for name, angle, sigma in seen
    )
    return GeometryError(
        where=f"target {target}",
        seen=f"sight rays near the horizon: {told or 'none'}",
        expected=f"rays that meet the ground at more than {GRAZING:g} sigmas of the attitude",
        advice="fly higher or nearer, give what the attitude is really worth, or leave on_ground out",
    )
