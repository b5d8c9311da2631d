"""The sights of the first boxes, and where two of them come nearest to each other.

A box of camera c in frame f is a sight: a half-line from where the camera was, through the box's middle, in ENU. Two
sights of one target were taken tau seconds apart. A target on its way may have moved by V tau, mostly sideways, so the
half-lines must come within (V tau, V tau, W tau) of each other, and within what attitude and position are worth, at
depths at which the target has a size that things have, about the same in both: depth = size * focal / box.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.camera import CameraModel, unproject
from calibration.foundation.arrays import Floats
from pipeline.flight import Flight
from pipeline.geometry import rotation
from pipeline.records import InstrumentSigma
from pipeline.stages.poses.measured import MeasuredPoses

SPEED_MPS, CLIMB_MPS = 30.0, 3.0
"""How fast a target may have moved between two sights: a car on a motorway, a hill. Doubled, a mount that is forgotten
is noticed only where the videos begin together."""
SMALLEST_M, LARGEST_M = 0.2, 40.0
"""Sizes of targets, a dog to a lorry with its trailer: they bound how far away a box of so many pixels can be."""
ALIKE = 3.0
"""How many times larger one camera may see a target than another: from its side and from its end. Boxes drawn by hand
of one target differ by 2 at most; doubled, a forgotten mount passes for a small thing close by."""
SIGMAS = 4.0
"""Of attitude, position and offset: what is within them is no doubt."""
DEPTHS = 60
"""Depths tried along a sight, evenly in their logarithm: the next is 9 % farther."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """One box as a half-line: where from (3,), unit direction (3,), ENU; bounds of its depth, one sigma across it."""

    camera: str
    target: str
    frame: int
    time_s: float
    origin_m: Floats
    direction: Floats
    near_m: float
    far_m: float
    sigma: InstrumentSigma
    pixel_rad: float

    @property
    def elevation_rad(self) -> float:
        """Above the horizon."""
        return float(np.arcsin(np.clip(self.direction[2], -1, 1)))

    def across_m(self, depth_m: Floats) -> Floats:
        """One sigma (n,) across the sight at depths (n,)."""
        s = self.sigma
        turn = math.hypot(s.attitude_bias_rad, s.attitude_rad, self.pixel_rad)
        return np.hypot(turn * depth_m, math.hypot(s.position_bias_m, s.position_m))


def sights_of(
    flight: Flight, measured: Sequence[MeasuredPoses], models: Mapping[str, CameraModel]
) -> tuple[Sight, ...]:
    """The sights of all boxes at whose frames there is a pose."""
    found = []
    for pose in measured:
        model = models[pose.camera]
        for target in flight.targets:
            box = target.boxes.get(pose.camera)
            row = np.flatnonzero(pose.poses.frame == box.frame) if box is not None else np.empty(0, int)
            if box is None or not len(row):
                continue
            ray = unproject(model, np.array([box.centre_px]))[0]
            if not np.isfinite(ray).all():
                continue
            focal = float(np.sqrt(abs(model.K[0, 0] * model.K[1, 1])))
            size_px = math.sqrt(box.width * box.height)
            found.append(
                Sight(
                    camera=pose.camera,
                    target=target.name,
                    frame=box.frame,
                    time_s=box.frame / pose.frame_rate,
                    origin_m=pose.poses.position_enu_m[row[0]],
                    direction=rotation.rotate(pose.poses.enu_from_cam[row[0]], ray / np.linalg.norm(ray)),
                    near_m=SMALLEST_M * focal / size_px,
                    far_m=LARGEST_M * focal / size_px,
                    sigma=pose.sigma,
                    pixel_rad=pose.sigma.pixel_px / focal,
                )
            )
    return tuple(found)


def offset_between(flight: Flight, one: MeasuredPoses, other: MeasuredPoses) -> tuple[float, float] | None:
    """Common time of `other`'s video time 0 on `one`'s video time, and its sigma; None where nothing says it."""
    if one.utc_s is not None and other.utc_s is not None:
        sigma = math.hypot(*(m.utc_sigma_s if m.utc_sigma_s is not None else 0.7 for m in (one, other)))
        return other.utc_s - one.utc_s, sigma
    given = [flight.camera(m.camera).offset_s for m in (one, other)]
    known = [0.0 if m.camera == flight.reference_camera else g for m, g in zip((one, other), given, strict=True)]
    if known[0] is None or known[1] is None:
        return None
    return known[1] - known[0], math.hypot(*(m.sigma.offset_s or 0.0 for m in (one, other)))


def closest(a: Sight, b: Sight, apart_s: float) -> tuple[float, float, float] | None:
    """Depths along two sights where they are nearest in terms of what may lie between them, and that distance (1: just
    within). None where a depth is not a number.
    """
    depth_a, depth_b = (np.geomspace(s.near_m, s.far_m, DEPTHS) for s in (a, b))
    place_a, place_b = (s.origin_m + d[:, None] * s.direction for s, d in ((a, depth_a), (b, depth_b)))
    apart = place_a[:, None] - place_b[None]
    noise = SIGMAS * np.hypot(a.across_m(depth_a)[:, None], b.across_m(depth_b)[None])
    step = 0.05 * (depth_a[:, None] + depth_b[None])  # half of the way to the next depth tried
    side = np.hypot(apart[..., 0], apart[..., 1]) / (SPEED_MPS * apart_s + noise + step)
    rise = np.abs(apart[..., 2]) / (CLIMB_MPS * apart_s + noise + step)
    size_a, size_b = (np.log(d / s.near_m) for s, d in ((a, depth_a), (b, depth_b)))
    unlike = np.abs(size_a[:, None] - size_b[None]) > math.log(ALIKE)
    score = np.where(unlike, np.inf, np.hypot(side, rise))
    i, j = np.unravel_index(int(np.argmin(score)), score.shape)
    return float(depth_a[i]), float(depth_b[j]), float(score[i, j])


def angle_between(a: Sight, b: Sight) -> float:
    """Between two sights, radians; a quarter turn at most."""
    return float(np.arctan2(np.linalg.norm(np.cross(a.direction, b.direction)), abs(a.direction @ b.direction)))
