"""Tracks as even samples in time: where from and whereto each camera looks at each target, ENU."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry import rotation
from pipeline.matching.settings import MatchSettings
from pipeline.records import CameraInput, InstrumentSigma


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """One camera on an even grid of its video time: sample k is at (first + k) * step_s.

    names         (m) its tracks
    centre_m      (n, 3) of the camera
    enu_from_cam  (n, 3, 3)
    ray           (m, n, 3) unit directions, NaN where a track has no fix
    pixel_rad     (m,) what a fix is worth
    still         (m,) whether a track may be of something that stands still
    """

    camera: str
    names: tuple[str, ...]
    first: int
    step_s: float
    centre_m: Floats
    enu_from_cam: Floats
    ray: Floats
    pixel_rad: Floats
    still: Bools
    sigma: InstrumentSigma

    @property
    def span_s(self) -> tuple[float, float]:
        """Video time of the first and the last sample."""
        return self.first * self.step_s, (self.first + len(self.centre_m) - 1) * self.step_s

    def at(self, video_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Centre (n, 3), enu_from_cam (n, 3, 3) and rays (m, n, 3) at video times; rays are NaN outside."""
        place = video_s / self.step_s - self.first
        low = np.clip(np.floor(place).astype(int), 0, max(0, len(self.centre_m) - 2))
        high = np.minimum(low + 1, len(self.centre_m) - 1)
        share = place - low
        inside = (share >= 0) & (share <= 1)
        part = np.clip(share, 0, 1)[:, None]
        centre = self.centre_m[low] * (1 - part) + self.centre_m[high] * part
        ray = self.ray[:, low] * (1 - part) + self.ray[:, high] * part
        ray = np.where(inside[:, None], ray / np.linalg.norm(ray, axis=2, keepdims=True), np.nan)
        return centre, self.enu_from_cam[np.where(part[:, 0] < 0.5, low, high)], ray


def sampled(camera: CameraInput, settings: MatchSettings) -> Sampled:
    """A camera's tracks with its measured poses applied; each sample is the mean of the fixes around it."""
    rays, poses, step = camera.rays, camera.poses, settings.step_s
    row = np.searchsorted(poses.frame, rays.frame)
    looks = rotation.rotate(poses.enu_from_cam[row], rays.direction_cam)
    frames, first = np.unique(rays.frame, return_index=True)
    time_s, of_frame = rays.time_s[first], np.searchsorted(poses.frame, frames)
    low, high = int(np.ceil(time_s[0] / step - 0.5)), int(np.floor(time_s[-1] / step + 0.5))
    grid_s: Floats = step * np.arange(low, high + 1).astype(float)
    mid_s, centre = _binned(time_s, poses.position_enu_m[of_frame], step)
    nearest = np.clip(np.searchsorted(time_s, grid_s), 0, len(time_s) - 1)
    tracks, pixel_rad = [], []
    for k in range(len(rays.targets)):
        mine = rays.target == k
        tracks.append(_track(rays.time_s[mine], looks[mine], grid_s, settings))
        pixel_rad.append(float(np.median(rays.sigma_rad[mine])) if mine.any() else 1.0)
    places = np.stack([np.interp(grid_s, mid_s, centre[:, axis]) for axis in range(3)], axis=1)
    turn = np.hypot(pixel_rad, camera.sigma.attitude_rad)
    return Sampled(
        camera=camera.camera,
        names=rays.targets,
        first=low,
        step_s=step,
        centre_m=places,
        enu_from_cam=rotation.matrix(poses.enu_from_cam[of_frame[nearest]]),
        ray=np.stack(tracks),
        pixel_rad=np.array(pixel_rad),
        still=np.array([_still(places, ray, float(t), settings) for ray, t in zip(tracks, turn, strict=True)]),
        sigma=camera.sigma,
    )


def _still(centre: Floats, ray: Floats, turn_rad: float, settings: MatchSettings) -> bool:
    """Whether the rays (n, 3) of a track may all come from one point."""
    seen = np.isfinite(ray[:, 0])
    if seen.sum() < 3:
        return True
    c, d = centre[seen], ray[seen]
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    weak = 1e-3 * np.outer(d.mean(0), d.mean(0))  # where nothing tells how far: near rather than nowhere
    start = c.mean(0) + 200.0 * d.mean(0)
    point = np.linalg.solve(across.mean(0) + weak, np.einsum("nij,nj->i", across, c) / len(c) + weak @ start)
    missed = np.einsum("nij,nj->ni", across, point - c)
    depth = float(np.median(np.linalg.norm(point - c, axis=1)))
    return bool(np.sqrt((missed**2).sum(1).mean()) < settings.still_m + depth * turn_rad)


def _track(time_s: Floats, look: Floats, grid_s: Floats, settings: MatchSettings) -> Floats:
    """Directions (n, 3) on the grid; NaN before, after and in gaps."""
    found = np.full((len(grid_s), 3), np.nan)
    if not len(time_s):
        return found
    mid_s, mean = _binned(time_s, look, settings.step_s)
    ray = np.stack([np.interp(grid_s, mid_s, mean[:, axis]) for axis in range(3)], axis=1)
    seen = _seen(mid_s, grid_s, settings)
    found[seen] = ray[seen] / np.linalg.norm(ray[seen], axis=1, keepdims=True)
    return found


def _seen(mid_s: Floats, grid_s: Floats, settings: MatchSettings) -> Bools:
    after: Ints = np.searchsorted(mid_s, grid_s)
    before_s = mid_s[np.clip(after - 1, 0, len(mid_s) - 1)]
    after_s = mid_s[np.clip(after, 0, len(mid_s) - 1)]
    inside = (grid_s >= mid_s[0] - settings.step_s / 2) & (grid_s <= mid_s[-1] + settings.step_s / 2)
    return np.asarray(inside & (np.abs(after_s - before_s) <= settings.gap_s))


def _binned(time_s: Floats, value: Floats, step_s: float) -> tuple[Floats, Floats]:
    """Means (k,) and (k, 3) over the grid's intervals that hold anything."""
    index = np.floor(time_s / step_s + 0.5).astype(int)
    _, place, count = np.unique(index, return_inverse=True, return_counts=True)
    mean_s = np.bincount(place, time_s) / count
    mean = np.stack([np.bincount(place, value[:, axis]) / count for axis in range(3)], axis=1)
    return mean_s, mean
