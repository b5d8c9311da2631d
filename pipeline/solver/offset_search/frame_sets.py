"""Frames of one camera for the polishing of clocks, and the covariance of what a whole frame says.

    S_f = diag(pixel) + attitude^2 J_w J_w' + position^2 J_p J_p'

couples all targets of a frame: its own attitude and position errors move them together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry.rotation import skew
from pipeline.solver.observation.observations import across
from pipeline.solver.offset_search.views import View


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameSet:
    """Some frames of one camera, a slot per target; empty slots have weight zero.

    time_s (f,), present (f, n), centre_m (f, 3), ray (f, n, 3), across (f, n, 2, 3) two unit vectors across the ray,
    axes (f, 3, 3), pixel_rad (f, n); camera_ray and camera_across are ray and across in axes of the camera, by_tilt
    (f, n, 2, 3) what a rotation in these axes does to an error along `across`
    """

    time_s: Floats
    present: Floats
    centre_m: Floats
    ray: Floats
    across: Floats
    axes: Floats
    pixel_rad: Floats
    camera_ray: Floats
    camera_across: Floats
    by_tilt: Floats


def frames_of(view: View, targets: Sequence[str], most: int) -> FrameSet:
    """At most `most` frames of a camera, spread evenly."""
    frames: Ints = np.unique(np.concatenate([view.tracks[t].frame for t in targets if t in view.tracks]))
    if len(frames) > most:
        frames = frames[np.linspace(0, len(frames) - 1, most).round().astype(np.int64)]
    f, n = len(frames), len(targets)
    time, centre, axes = np.zeros(f), np.zeros((f, 3)), np.zeros((f, 3, 3))
    present, pixel, ray = np.zeros((f, n)), np.ones((f, n)), np.tile([0.0, 0.0, 1.0], (f, n, 1))
    for k, target in enumerate(targets):
        if target not in view.tracks:
            continue
        track = view.tracks[target]
        mine = np.isin(track.frame, frames)
        at = np.searchsorted(frames, track.frame[mine])
        time[at], centre[at], axes[at] = track.time_s[mine], track.centre_m[mine], track.axes[mine]
        present[at, k], pixel[at, k], ray[at, k] = 1.0, track.pixel_rad[mine], track.ray[mine]
    beside = across(ray.reshape(-1, 3)).reshape(f, n, 2, 3)
    return FrameSet(
        time_s=time, present=present, centre_m=centre, ray=ray, across=beside, axes=axes, pixel_rad=pixel,
        camera_ray=ray @ axes, camera_across=beside @ axes[:, None], by_tilt=beside @ skew(ray) @ axes[:, None],
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Whitening:
    """inverse (f, 2 n, 2 n) of the Cholesky factor of S_f; `widening`, the logarithm of how much wider than by
    pixel and attitude alone the predicted residuals are.

    The widening is part of the likelihood: without it a target that rides along with a camera, where position errors
    excuse every angle, would explain everything.
    """

    inverse: Floats
    widening: float


def whitening(view: View, frames: FrameSet, depth_m: Floats) -> Whitening:
    """Of frames whose targets are `depth_m` (f, n) away."""
    f, n = frames.present.shape
    there = np.repeat(frames.present, 2, axis=1)[..., None]
    attitude_bias = frames.by_tilt.reshape(f, 2 * n, 3) * there
    position_bias = (frames.across / depth_m[..., None, None]).reshape(f, 2 * n, 3) * there
    own = np.where(there > 0, np.repeat(frames.pixel_rad, 2, axis=1)[..., None] ** 2, 1.0)
    plain = own * np.eye(2 * n) + view.attitude_noise_rad**2 * attitude_bias @ np.swapaxes(attitude_bias, 1, 2)
    whole = plain + view.position_noise_m**2 * position_bias @ np.swapaxes(position_bias, 1, 2)
    factor = np.linalg.cholesky(whole)
    inverse = np.linalg.inv(factor)
    _, narrow = np.linalg.slogdet(plain)
    wide = 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum()
    return Whitening(inverse=np.asarray(inverse, float), widening=0.5 * float(wide - narrow.sum()))
