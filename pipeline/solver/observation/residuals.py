"""Residual of every sighting and its exact derivatives, for all methods.

A frame's pose error e = (w, p) turns and moves its measured pose: R = exp(w) R_measured, C = C_measured + p, with
w a rotation vector in camera axes, and e = bias + spread * u, u the frame's own unknown (6,) with unit prior. With
y = R (X - C), and a focal scale exp(phi) that takes y to (k y1, k y2, y3), k = exp(a phi + b phi^2 / 2) by the
sighting's focal effect (a, b), (1, 0) without distortion:

    r = gain y / depth          G = dr/dy = (gain - r d') / depth    (G = gain where the residual is metric)
    dr/dX = G R                 dr/dp = -G R                         dr/d phi = G (k y1, k y2, 0) (a + b phi)
    dr/dw = G [-y]x J(w)        J(w) = I + (1 - cos a)/a^2 [w]x + (a - sin a)/a^3 [w]x^2,  a = |w|

J is the left Jacobian of the rotation group, so the derivative is exact however large w is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.geometry import rotation
from pipeline.solver.observation.clocks import CAMERA_PARAMETERS
from pipeline.solver.observation.observations import NEAREST_COSINE, Frames


def left_jacobian(w: Floats) -> Floats:
    """J (n, 3, 3) with exp(w + dw) = exp(J dw) exp(w) to first order."""
    square = (w * w).sum(-1)[..., None, None]
    small = square < 1e-8
    safe = np.where(small, 1.0, square)
    angle = np.sqrt(safe)
    a = np.where(small, 0.5 - square / 24, (1 - np.cos(angle)) / safe)
    b = np.where(small, 1 / 6 - square / 120, (angle - np.sin(angle)) / (safe * angle))
    cross = rotation.skew(w)
    return np.asarray(np.eye(3) + a * cross + b * (cross @ cross))


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    """Residuals and derivatives of n frames and N targets.

    residual (n, N, 2); by_position (n, N, 2, 3); by_pose (n, N, 2, 6); by_focal (n, N, 2);
    by_pose_time (n, N, 2), zero where poses cannot be moved in time; ahead (n, N): the target is before the camera
    """

    residual: Floats
    by_position: Floats
    by_pose: Floats
    by_focal: Floats
    by_pose_time: Floats
    ahead: Floats


def place_shift(frames: Frames, part: slice, camera: Floats) -> Floats:
    """(n, N, 2) what the place errors among the cameras' parameters (C, W) add to the residuals of `part`."""
    place = camera[frames.camera[part], CAMERA_PARAMETERS:].reshape(len(frames.camera[part]), -1, 2, 2)
    pixels = place[..., 0] + frames.place_share[part, None, None] * place[..., 1]
    return np.asarray(pixels * frames.place_gain[part, :, None])


def magnifications(frames: Frames, part: slice, focal: Floats) -> tuple[Floats, Floats]:
    """k and d ln k / d phi, both (n, N) or (n, 1), at log focal scales (n,) of the frames `part`."""
    if len(frames.focal_effect) == 0:
        return np.exp(focal)[:, None], np.ones((len(focal), 1))
    a, b = np.moveaxis(frames.focal_effect[part], -1, 0)
    phi = focal[:, None]
    return np.exp((a + 0.5 * b * phi) * phi), a + b * phi


def linearise(frames: Frames, part: slice, target_m: Floats, pose_error: Floats, focal: Floats) -> Linearised:
    """At target positions (n, N, 3), pose errors (n, 6) and log focal scales (n,) of the frames `part`."""
    w, p = pose_error[:, :3], pose_error[:, 3:]
    turn = rotation.matrix(rotation.exp(w))
    cam_from_enu = turn @ frames.cam_from_enu[part]
    away = target_m - (frames.position_m[part] + p)[:, None]
    y = away @ np.swapaxes(cam_from_enu, 1, 2)
    factor, growth = magnifications(frames, part, focal)
    magnified = np.ones((len(w), factor.shape[1], 3))
    magnified[..., :2] = factor[..., None]
    seen_y, gain, ray = y * magnified, frames.gain[part], frames.ray[part]
    flat = (gain @ seen_y[..., None])[..., 0]
    along = (ray * seen_y).sum(-1)
    if frames.angular:
        nearest = NEAREST_COSINE * np.linalg.norm(y, axis=-1)
        depth = np.maximum(along, np.maximum(nearest, 1e-9))[..., None]
        residual = flat / depth
        by_seen = (gain - residual[..., None] * ray[..., None, :]) / depth[..., None]
    else:
        residual, by_seen = flat, gain
    by_y = by_seen * magnified[:, :, None]
    by_position = by_y @ cam_from_enu[:, None]
    by_turn = np.cross(y[..., None, :], by_y)
    by_pose_time = np.zeros(residual.shape)
    if frames.pose_rate is not None:
        rate = frames.pose_rate[part]
        spin = (turn @ rate[:, :3, None])[..., 0]
        by_pose_time = (by_turn @ spin[:, None, :, None] - by_position @ rate[:, None, 3:, None])[..., 0]
    return Linearised(
        residual=residual,
        by_position=by_position,
        by_pose=np.concatenate([by_turn @ left_jacobian(w)[:, None], -by_position], axis=-1),
        by_focal=(by_y[..., :2] * y[..., None, :2]).sum(-1) * growth[..., None],
        by_pose_time=by_pose_time,
        ahead=np.asarray(along > 0, float),
    )
