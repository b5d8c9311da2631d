"""Who takes part in a flight, and when: names, colours, frame times. What every figure asks first."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.records import PoseTrack, Results, Sightings, Trajectory
from pipeline.report.text.words import whole

COLOURS = 8
UNSEEN_S, UNSURE = 1.0, 6.0


def targets(results: Results) -> tuple[str, ...]:
    """Targets in the solution's order, then any that were tracked only."""
    solved = [m.target for m in results.solution.motions] + [t.target for t in results.trajectories]
    return tuple(dict.fromkeys(solved + [t.target for t in results.tracks]))


def cameras(results: Results) -> tuple[str, ...]:
    """Cameras in the solution's order."""
    solution = results.solution
    named = [c.camera for c in solution.clocks] + [p.camera for p in solution.poses]
    return tuple(dict.fromkeys(named + [t.camera for t in results.tracks]))


def tone(results: Results, target: str) -> str:
    """CSS classes that give a target its colour; from the ninth on the colours return, dashed."""
    index = targets(results).index(target)
    return f"c{index % COLOURS}" + (" again" if index >= COLOURS else "")


def time_span(results: Results) -> tuple[float, float]:
    """First and last common time at which anything was seen."""
    times = [t.time_s for t in results.trajectories] + [results.solution.sightings.time_s]
    pool = np.concatenate([np.zeros(0), *times])
    pool = pool[np.isfinite(pool)]
    if not len(pool) or np.ptp(pool) <= 0:
        return 0.0, 1.0
    low, high = float(pool.min()), float(pool.max())
    return (0.0 if 0 < low < 0.03 * high else low), high


def frame_times(results: Results, camera: str, frames: Ints) -> Floats:
    """Common time (n,) of `frames` (n,): the tracks' video times where they know them, else the nominal rate."""
    clock = next((c for c in results.solution.clocks if c.camera == camera), None)
    if clock is None:
        return np.full(len(frames), np.nan)
    own = [k for k in results.tracks if k.camera == camera and len(k.frame)]
    even = np.asarray(frames, float) / clock.nominal_rate
    if own:
        known, at = np.unique(np.concatenate([k.frame for k in own]), return_index=True)
        lead = np.concatenate([k.time_s for k in own])[at] - known / clock.nominal_rate
        even = even + np.interp(frames, known, lead)
    return clock.common_time_s(even)


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPath:
    """Refined path of one camera, thinned: common time (n,), position (n, 3) ENU m, attitude (n, 4) enu_from_cam."""

    camera: str
    time_s: Floats
    position_enu_m: Floats
    enu_from_cam: Floats

    @property
    def still(self) -> bool:
        """Whether the camera moved less than 5 cm in all."""
        return bool(np.ptp(self.position_enu_m, axis=0).max(initial=0.0) < 0.05)


def camera_paths(results: Results, limit: int = 600) -> tuple[CameraPath, ...]:
    """Paths of all cameras with at most `limit` poses each."""
    return tuple(_camera_path(results, p, limit) for p in results.solution.poses if len(p.frame))


def _camera_path(results: Results, poses: PoseTrack, limit: int) -> CameraPath:
    at = thinned(len(poses.frame), limit)
    return CameraPath(
        camera=poses.camera,
        time_s=frame_times(results, poses.camera, poses.frame[at]),
        position_enu_m=poses.position_enu_m[at],
        enu_from_cam=poses.enu_from_cam[at],
    )


def thinned(n: int, limit: int) -> Ints:
    """At most `limit` of the indices 0 .. n - 1, evenly spaced, the first and the last among them."""
    if n <= limit:
        return np.arange(n)
    return np.unique(np.round(np.linspace(0, n - 1, limit)).astype(np.int64))


def thin_trajectory(trajectory: Trajectory, limit: int) -> Trajectory:
    """The trajectory at `limit` of its samples."""
    return part_of(trajectory, thinned(len(trajectory.time_s), limit))


def part_of(trajectory: Trajectory, at: Ints | Bools) -> Trajectory:
    """The trajectory at some of its samples."""
    return Trajectory(
        target=trajectory.target,
        time_s=trajectory.time_s[at],
        position_enu_m=trajectory.position_enu_m[at],
        velocity_mps=trajectory.velocity_mps[at],
        covariance=trajectory.covariance[at],
    )


def thinning_words(results: Results, limit: int) -> str:
    """A sentence where trajectories have more samples than are drawn, else ""."""
    most = max((len(t.time_s) for t in results.trajectories), default=0)
    return "" if most <= limit else f" Curves are drawn through {whole(limit)} of up to {whole(most)} samples."


def well_known(results: Results, trajectory: Trajectory) -> Bools:
    """(n,) where the target's place is known: seen less than a second away, sigma below six times its median.

    Elsewhere the motion only bridges a gap; figures draw it dotted and leave it out of their ranges.
    """
    times = np.sort(results.solution.sightings.time_s[rows_of(results.solution.sightings, target=trajectory.target)])
    n = len(trajectory.time_s)
    if not len(times) or not n:
        return np.ones(n, bool)
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    after = np.searchsorted(times, trajectory.time_s).clip(1, max(len(times) - 1, 1))
    around = times[np.stack([after - 1, np.minimum(after, len(times) - 1)])]
    near = np.abs(around - trajectory.time_s).min(axis=0) <= max(UNSEEN_S, 3 * usual)
    sigma = trajectory.sigma_m
    good = sigma[near & np.isfinite(sigma)]
    limit = UNSURE * float(np.median(good)) if len(good) else np.inf
    known = near & ~(sigma > limit)
    return known if known.any() else np.ones(n, bool)


def known_part(results: Results, trajectory: Trajectory) -> Trajectory:
    """The samples of the trajectory that are `well_known`."""
    return part_of(trajectory, well_known(results, trajectory))


def rows_of(sightings: Sightings, camera: str | None = None, target: str | None = None) -> Ints:
    """Indices of the sightings of one camera, one target, or both."""
    keep = np.ones(len(sightings.frame), bool)
    for name, (names, place) in zip((camera, target), _places(sightings), strict=True):
        if name is not None:
            keep &= place == names.get(name, -1)
    return np.flatnonzero(keep)


@lru_cache(maxsize=1)
def _places(sightings: Sightings) -> tuple[tuple[dict[str, int], Ints], tuple[dict[str, int], Ints]]:
    """Of cameras and of targets: every name's number, and the number (m,) of each sighting's."""
    found = []
    for column in (sightings.camera, sightings.target):
        names = {name: k for k, name in enumerate(dict.fromkeys(column))}
        found.append((names, np.array([names[name] for name in column], dtype=np.int64)))
    return found[0], found[1]


def true_trajectory(results: Results, target: str) -> Trajectory | None:
    """The true trajectory of one target, where it is known."""
    known = results.truth.trajectories if results.truth is not None else ()
    return next((t for t in known if t.target == target and len(t.time_s) > 1), None)
