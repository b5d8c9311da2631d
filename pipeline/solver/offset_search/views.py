"""What the global search sees of a camera: world rays with measured poses, cleaned, thinned, interpolated.

A world ray is x(r) = C + r d with C the measured optical centre (paper eq. 3) and d the measured sight-ray (paper
eq. 4), both in ENU. The search works on rays alone: lens, frames and quaternions stay behind. A clock is the pair
(offset beta, clock_scale s): common time t = s tau + beta, s = nominal rate / alpha (paper eq. 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import CameraInput, Problem

GAP_S = 1.0
"""Rays are never interpolated across a longer hole than this (or three times the usual step)."""
RATE_S = 0.1
"""Over so long to each side the rate of a ray is taken: longer than the noise of labels, shorter than manoeuvres."""
WINDOW = 9
"""Samples on which a label is held against its neighbours."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Interpolated:
    """A track between its own sightings: centres and rays (..., 3), the nearest row, and where there is support."""

    centre_m: Floats
    ray: Floats
    near: Ints
    holds: Bools


@dataclass(frozen=True, kw_only=True, eq=False)
class Between:
    """Places (...,) between two rows of a track: how far from the left to the right one, and if that is supported."""

    left: Ints
    right: Ints
    share: Floats
    holds: Bools


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One target in one camera, ordered by video time.

    time_s       (n,) video time
    frame        (n,)
    centre_m     (n, 3) ENU
    ray          (n, 3) ENU, unit
    axes         (n, 3, 3) enu_from_cam
    pixel_rad    (n,) sigma of the direction from the image alone
    """

    time_s: Floats
    frame: Ints
    centre_m: Floats
    ray: Floats
    axes: Floats
    pixel_rad: Floats

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def bridged_s(self) -> float:
        """The longest hole that may be interpolated across."""
        return max(GAP_S, 3 * float(np.median(np.diff(self.time_s))))

    @cached_property
    def packed(self) -> Floats:
        """(n, 12): centre, ray, and by how much both change per second, taken over RATE_S to each side."""
        early, late = self.at(self.time_s - RATE_S), self.at(self.time_s + RATE_S)
        ray_rate, centre_rate = late.ray - early.ray, late.centre_m - early.centre_m
        return np.concatenate([self.centre_m, self.ray, centre_rate / (2 * RATE_S), ray_rate / (2 * RATE_S)], axis=1)

    def taken(self, index: Ints | Bools) -> Track:
        """Some of its rows."""
        return Track(
            time_s=self.time_s[index],
            frame=self.frame[index],
            centre_m=self.centre_m[index],
            ray=self.ray[index],
            axes=self.axes[index],
            pixel_rad=self.pixel_rad[index],
        )

    def at(self, time_s: Floats) -> Interpolated:
        """The track at video times (...,), linear in between."""
        place = self.between(time_s)
        left, right, w = place.left, place.right, place.share[..., None]
        centre = (1 - w) * self.centre_m[left] + w * self.centre_m[right]
        ray = (1 - w) * self.ray[left] + w * self.ray[right]
        ray /= np.sqrt((ray**2).sum(-1))[..., None]
        near = np.where(place.share < 0.5, left, right)
        return Interpolated(centre_m=centre, ray=ray, near=near, holds=place.holds)

    def between(self, time_s: Floats) -> Between:
        """Where video times (...,) lie among the track's own."""
        right = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self) - 1)
        left = right - 1
        width = self.time_s[right] - self.time_s[left]
        share = np.clip((time_s - self.time_s[left]) / width, 0.0, 1.0)
        holds = (width <= self.bridged_s) & (time_s >= self.time_s[0]) & (time_s <= self.time_s[-1])
        return Between(left=left, right=right, share=share, holds=holds)


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One camera: its tracks by target name, and what its instruments are worth.

    attitude_bias_rad, position_bias_m            sigma of the constant attitude and position error
    attitude_noise_rad, position_noise_m  of the part that is independent from frame to frame
    """

    camera: str
    tracks: dict[str, Track]
    attitude_bias_rad: float
    position_bias_m: float
    attitude_noise_rad: float
    position_noise_m: float

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last video time of any sighting."""
        tracks = self.tracks.values()
        return min(t.time_s[0] for t in tracks), max(t.time_s[-1] for t in tracks)


def views(problem: Problem) -> dict[str, View]:
    """Every camera of the problem as the search sees it; a target seen fewer than four times is left out."""
    return {c.camera: _view(c) for c in problem.cameras}


def _view(camera: CameraInput) -> View:
    rays, sigma = camera.rays, camera.sigma
    row = np.searchsorted(camera.poses.frame, rays.frame)
    centre = camera.poses.position_enu_m[row]
    axes = rotation.matrix(camera.poses.enu_from_cam[row])
    ray = (axes @ rays.direction_cam[:, :, None])[:, :, 0]
    off_axis = np.hypot(rays.direction_cam[:, 0], rays.direction_cam[:, 1])
    pixel = np.hypot(rays.sigma_rad, sigma.focal * off_axis)
    tracks = {}
    for index, target in enumerate(rays.targets):
        mine = np.flatnonzero(rays.target == index)
        order = mine[np.argsort(rays.time_s[mine], kind="stable")]
        order = order[np.diff(rays.time_s[order], prepend=-np.inf) > 0]
        track = Track(
            time_s=rays.time_s[order],
            frame=rays.frame[order],
            centre_m=centre[order],
            ray=ray[order],
            axes=axes[order],
            pixel_rad=pixel[order],
        )
        if len(track) >= 4:
            tracks[target] = cleaned(track, sigma.attitude_rad)
    return View(
        camera=camera.camera,
        tracks=tracks,
        attitude_bias_rad=max(sigma.attitude_bias_rad, 1e-6),
        position_bias_m=max(sigma.position_bias_m, 1e-6),
        attitude_noise_rad=sigma.attitude_rad,
        position_noise_m=sigma.position_m,
    )


def cleaned(track: Track, attitude_noise_rad: float) -> Track:
    """The track without labels that jump: further from the median of their neighbours than five robust sigmas."""
    half = WINDOW // 2
    if len(track) < 2 * WINDOW:
        return track
    at = np.clip(np.arange(len(track))[:, None] + np.arange(-half, half + 1), 0, len(track) - 1)
    middle = np.median(track.ray[at], axis=1)
    away = np.linalg.norm(track.ray - middle, axis=1)
    usual = 1.4826 * np.median(away[at], axis=1)
    noise = np.hypot(track.pixel_rad, attitude_noise_rad)
    kept = away <= 5 * np.maximum(usual, noise)
    return track.taken(kept) if kept.sum() >= 4 else track


def thinned(track: Track, step_s: float, most: int) -> Track:
    """At most `most` rows of the track, at least about `step_s` apart, spread evenly over its own sightings."""
    bins = np.floor((track.time_s - track.time_s[0]) / max(step_s, 1e-9)).astype(np.int64)
    first = np.flatnonzero(np.diff(bins, prepend=-1) > 0)
    if len(first) > most:
        first = first[np.linspace(0, len(first) - 1, most).round().astype(np.int64)]
    return track.taken(first)


def share_together(one_s: Sequence[Floats] | Floats, other_s: Sequence[Floats] | Floats) -> Floats:
    """Of two spans of common time (first, last), each (...,), the share of the shorter in which both go on."""
    both = np.minimum(one_s[1], other_s[1]) - np.maximum(one_s[0], other_s[0])
    return np.asarray(both / np.maximum(np.minimum(one_s[1] - one_s[0], other_s[1] - other_s[0]), 1e-9))
