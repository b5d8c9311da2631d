"""The observations of a problem as plain arrays: every frame of every camera in one row, cameras one after another.

A frame and a target that it does not see have gain zero, so that every frame has the same shape and a target that is
hidden costs nothing but the place.

The residual of an observation is r = gain y / depth with y = R (X - C) in camera axes. The statistical method takes
gain = pixel_from_ray / sigma_px and depth = d . y, so r is the reprojection error in sigmas; the paper's methods take
gain = an orthonormal basis of the plane across the ray and depth = 1, so |r| = |V (X - C)| metres (paper eq. 5).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.geometry import rotation
from pipeline.records import CameraInput, Problem

NEAREST_COSINE = 0.05
"""A point further than acos(0.05) from the optical ray is taken as that far: finite, and never attractive."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Of cameras with a rolling shutter; see `rolling_shutter`.

    fraction  (F, N) where the sighting's row is, -1/2 first to 1/2 last; zero where unseen and without such a shutter
    rate      (F, 6) rotation vector (camera axes, of cam_from_enu) and velocity of the measured pose, per second
    turn      (F, N, 3, 3) by which rays and gains stand turned, from the whole frame's instant to the row's; gains of
              metric residuals are stretched by it as well
    """

    fraction: Floats
    rate: Floats
    turn: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """All frames (F in all), C cameras, N targets.

    nominal_rate  (C,) frame rates as given, Hz
    first         (C + 1,) where each camera's frames begin
    camera        (F,) index
    frame, video_s  (F,) number and video time
    cam_from_enu  (F, 3, 3) as measured
    position_m    (F, 3) as measured
    pose_rate     (F, 6) rotation vector (camera axes, of cam_from_enu) and velocity by which the measured pose changes
                  per second of log time; None: no camera's poses can be moved in time
    pose_shift_s  (F,) log time for which the poses hold, counted from where the problem took them
    pose_taken_s  (F,) log time at which they were last read from the log
    ray           (F, N, 3) unit; gain (F, N, 2, 3); seen (F, N)
    sigma_px      (F, N), NaN where unseen
    focal_effect  (F, N, 2) see SightRays; without frames where all are (1, 0)
    place_gain    (F, N) what a pixel of place error adds to a residual; share (F,) of the drifting part, -1 to 1
    angular       true: divided by the depth
    rows          None: no camera has a rolling shutter
    by_readout    (F, N, 2) derivative of the residuals by the readout; without frames where none is refined
    """

    cameras: tuple[str, ...]
    targets: tuple[str, ...]
    nominal_rate: Floats
    first: Ints
    camera: Ints
    frame: Ints
    video_s: Floats
    cam_from_enu: Floats
    position_m: Floats
    pose_rate: Floats | None
    pose_shift_s: Floats
    pose_taken_s: Floats
    ray: Floats
    gain: Floats
    seen: Bools
    sigma_px: Floats
    focal_effect: Floats
    place_gain: Floats
    place_share: Floats
    angular: bool
    rows: Rows | None = None
    by_readout: Floats = field(default_factory=lambda: np.zeros((0, 0, 2)))

    @property
    def count(self) -> int:
        """Number of frames in all."""
        return len(self.camera)

    def of(self, camera: int) -> slice:
        """The frames of one camera."""
        return slice(int(self.first[camera]), int(self.first[camera + 1]))


def across(direction: Floats) -> Floats:
    """Two orthonormal rows (n, 2, 3) that span the plane across unit directions (n, 3)."""
    d = np.asarray(direction, float)
    helper = np.eye(3)[np.abs(d).argmin(axis=-1)]
    one = np.cross(d, helper)
    one /= np.linalg.norm(one, axis=-1, keepdims=True)
    return np.stack([one, np.cross(d, one)], axis=-2)


def _camera_arrays(given: CameraInput, index: dict[str, int], lensed: bool) -> tuple[Floats, ...]:
    """Rays, pixel gains, pixel sigmas, video time and, if `lensed`, focal effects, dense over frames and targets."""
    rays, n_frames, n_targets = given.rays, len(given.poses.frame), len(index)
    place = np.searchsorted(given.poses.frame, rays.frame)
    column = np.array([index[name] for name in rays.targets], dtype=np.int64)[rays.target]
    ray = np.zeros((n_frames, n_targets, 3))
    ray[..., 2] = 1.0
    gain = np.zeros((n_frames, n_targets, 2, 3))
    sigma = np.full((n_frames, n_targets), np.nan)
    ray[place, column] = rays.direction_cam
    gain[place, column] = rays.pixel_from_ray / rays.sigma_px[:, None, None]
    sigma[place, column] = rays.sigma_px
    video = np.full(n_frames, np.nan)
    video[place] = rays.time_s
    effect = np.tile([1.0, 0.0], (n_frames if lensed else 0, n_targets, 1))
    if rays.focal_effect is not None:
        effect[place, column] = rays.focal_effect
    return ray, gain, sigma, video, effect


def _share(video_s: Floats) -> Floats:
    """Video times scaled to -1 at the first and 1 at the last."""
    low, high = video_s.min(), video_s.max()
    return np.asarray((2 * video_s - low - high) / max(high - low, 1e-9))


def pack(problem: Problem) -> Frames:
    """The observations of `problem`, with the reprojection error in sigmas as residual."""
    index = {t.target: i for i, t in enumerate(problem.targets)}
    lensed = any(c.rays.focal_effect is not None for c in problem.cameras)
    parts = [_camera_arrays(c, index, lensed) for c in problem.cameras]
    ray, gain, sigma, video, effect = (np.concatenate([p[i] for p in parts]) for i in range(5))
    count = [len(c.poses.frame) for c in problem.cameras]
    return Frames(
        cameras=tuple(c.camera for c in problem.cameras),
        targets=tuple(index),
        nominal_rate=np.array([c.frame_rate for c in problem.cameras]),
        first=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        camera=np.repeat(np.arange(len(count)), count),
        frame=np.concatenate([c.poses.frame for c in problem.cameras]),
        video_s=video,
        cam_from_enu=np.ascontiguousarray(
            rotation.matrix(rotation.conjugate(np.concatenate([c.poses.enu_from_cam for c in problem.cameras])))
        ),
        position_m=np.concatenate([c.poses.position_enu_m for c in problem.cameras]),
        pose_rate=None,
        pose_shift_s=np.zeros(sum(count)),
        pose_taken_s=np.zeros(sum(count)),
        ray=ray,
        gain=gain,
        seen=np.isfinite(sigma),
        sigma_px=sigma,
        focal_effect=effect,
        place_gain=np.where(np.isfinite(sigma), 1 / sigma, 0.0),
        place_share=np.concatenate([_share(p[3]) for p in parts]),
        angular=True,
    )


def metric(frames: Frames) -> Frames:
    """The same frames with the paper's residual V (X - C) in metres."""
    gain = across(frames.ray) * frames.seen[..., None, None]
    return replace(frames, gain=gain, angular=False)


def scaled_metric(frames: Frames, distance_m: Floats, bias_rad: Floats) -> Frames:
    """Linear in the motion like the paper's residual, weighted like the angular one at `distance_m` (F, N).

    Every sighting's sigma also holds its camera's unknown constant rotation, `bias_rad` (C,) per axis.
    """
    square = 0.5 * (frames.gain**2).sum(axis=(-1, -2)) * bias_rad[frames.camera, None] ** 2
    weight = 1 / (distance_m * np.sqrt(1 + square))
    return replace(frames, gain=frames.gain * weight[..., None, None], angular=False)


def with_poses_of(frames: Frames, moved: Frames) -> Frames:
    """`frames` with the poses that `moved` has come to."""
    return replace(
        frames,
        cam_from_enu=moved.cam_from_enu,
        position_m=moved.position_m,
        pose_rate=moved.pose_rate,
        pose_shift_s=moved.pose_shift_s,
        pose_taken_s=moved.pose_taken_s,
    )
