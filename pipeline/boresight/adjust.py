"""Boresight: how a camera really sits, and when its video began, from targets whose places are known.

Observation m of frame f sees target n, known to be at X_n(t_f), along the ray d in camera axes. With the pose that
the log gives for frame f at a start moved by delta, (p, cam_from_enu), the target is in camera axes at

    y = exp(w) cam_from_enu(delta) (X_n + e_n - p(delta) - b),     r = pixel_from_ray y / (d . y) + u_n

* w       rotation of the camera in its mount (radians, camera axes), what is asked for; a constant error of the
          autopilot's attitude cannot be told from it;
* delta   true start minus the given one, seconds; held where its sigma is zero;
* b, e_n  constant errors of the camera's and of each target's place, with their priors;
* u_n     where the tracked point sits on its target, pixels, with its prior.

Frames also err by themselves, in attitude and position: that is in each frame's covariance, with which all that the
frame saw is whitened. Gauss-Newton from the rotation that turns the seen directions best onto the known ones (Wahba),
frames further off than three sigmas are bounded (Huber).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints, frozen, settle
from pipeline.geometry import rotation
from pipeline.records import InstrumentSigma, PoseTrack, SightRays

LOOSE_TURN_RAD = 1.0
"""Prior of w: loose enough for a mount of which nothing is known, it only keeps the equations solvable."""
HUBER_SIGMAS = 3.0
STEP = (1e-6, 1e-4, 1e-3, 1e-3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """Where the targets were: `place_enu_m` (m, 3) of every observation, `sigma_m` of a target's constant error."""

    place_enu_m: Floats
    sigma_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Boresight:
    """What was found.

    rotation_rad  (3,) w: cam_from_enu (true) = exp(w) cam_from_enu (measured)
    start_s       delta
    covariance    (4, 4) of (w, delta); its last row is zero where delta is held
    misfit        RMS of the whitened residuals; where it is above 1 the covariance is enlarged by its square
    weight        (f,) of each frame by the robust loss
    """

    rotation_rad: Floats
    start_s: float
    covariance: Floats
    misfit: float
    weight: Floats

    def __post_init__(self) -> None:
        settle(
            self,
            rotation_rad=frozen(self.rotation_rad, (3,), "rotation_rad"),
            covariance=frozen(self.covariance, (4, 4), "covariance"),
            weight=frozen(self.weight, (None,), "weight"),
        )


def find_boresight(
    rays: SightRays,
    known: Known,
    poses_at: Callable[[float], PoseTrack],
    sigma: InstrumentSigma,
    *,
    start_sigma_s: float,
) -> Boresight:
    """The boresight of one camera; `poses_at` gives the measured poses of the rays' frames at a start moved by seconds.

    `sigma.attitude_bias_rad` is not used: the mount takes it up. `start_sigma_s` zero holds the start.
    """
    frames, frame = np.unique(rays.frame, return_inverse=True)
    first = _wahba(rays, known, poses_at(0.0), frame)
    widths = (3, 1, 3, 3 * len(rays.targets), 2 * len(rays.targets))
    prior = np.concatenate([
        np.full(widths[0], LOOSE_TURN_RAD), [start_sigma_s], np.full(widths[2], sigma.position_bias_m),
        np.full(widths[3], known.sigma_m), np.full(widths[4], np.hypot(*rays.place_sigma_px)),
    ])  # fmt: skip
    free = prior > 0
    x = np.zeros(len(prior))
    x[:3] = first

    def residual(state: Floats) -> Floats:
        return _residual_px(rays, known, poses_at(float(state[3])), frame, state)

    weight, normal = np.ones(len(frames)), np.zeros((int(free.sum()),) * 2)
    for _ in range(30):
        root = _whitening(rays, known, poses_at(float(x[3])), frame, x, sigma)
        r = _white(root, residual(x), frame, len(frames))
        J = np.stack([_white(root, c, frame, len(frames)) for c in _columns(residual, x, widths)[free]], axis=-1)
        size = np.array([np.sqrt(np.mean(part**2)) for part in _split(r, frame, len(frames))])
        weight = HUBER_SIGMAS / np.maximum(size, HUBER_SIGMAS)
        w = weight[frame][:, None]
        normal = np.einsum("mij,mi,mik->jk", J, np.broadcast_to(w, r.shape), J) + np.diag(1 / prior[free] ** 2)
        right = (
            np.einsum("mij,mi->j", J, w * r)
            + ((x - np.r_[first, np.zeros(len(x) - 3)]) / np.where(free, prior, 1) ** 2)[free]
        )
        step = np.zeros(len(x))
        step[free] = -np.linalg.solve(normal, right)
        x = x + step
        x[:3] = rotation.log(rotation.multiply(rotation.exp(step[:3]), rotation.exp(x[:3] - step[:3])))
        if np.abs(step[:3]).max() < 1e-7 and abs(step[3]) < 1e-6:
            break
    misfit = float(np.sqrt(np.sum(weight[frame][:, None] * r**2) / max(1, 2 * len(r) - int(free[:4].sum()))))
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(free, free)] = np.linalg.inv(normal) * max(1.0, misfit**2)
    return Boresight(
        rotation_rad=x[:3], start_s=float(x[3]), covariance=covariance[:4, :4], misfit=misfit, weight=weight
    )


def _wahba(rays: SightRays, known: Known, poses: PoseTrack, frame: Ints) -> Floats:
    """The rotation (3,) that turns the known directions onto the seen ones best, all alike."""
    want = _in_camera(known.place_enu_m - poses.position_enu_m[frame], poses, frame)
    want = want / np.linalg.norm(want, axis=1, keepdims=True)
    U, _, Vt = np.linalg.svd(rays.direction_cam.T @ want)
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return rotation.log(rotation.from_matrix(turn))


def _in_camera(offset_enu_m: Floats, poses: PoseTrack, frame: Ints) -> Floats:
    return rotation.rotate(rotation.conjugate(poses.enu_from_cam[frame]), offset_enu_m)


def _targets_in_camera(rays: SightRays, known: Known, poses: PoseTrack, frame: Ints, x: Floats) -> Floats:
    """y (m, 3)."""
    shift = x[7 : 7 + 3 * len(rays.targets)].reshape(-1, 3)[rays.target]
    offset = known.place_enu_m + shift - poses.position_enu_m[frame] - x[4:7]
    return rotation.rotate(rotation.exp(x[:3]), _in_camera(offset, poses, frame))


def _residual_px(rays: SightRays, known: Known, poses: PoseTrack, frame: Ints, x: Floats) -> Floats:
    """(m, 2)."""
    y = _targets_in_camera(rays, known, poses, frame, x)
    along = np.sum(rays.direction_cam * y, axis=1)
    on_target = x[7 + 3 * len(rays.targets) :].reshape(-1, 2)[rays.target]
    return np.asarray((rays.pixel_from_ray @ y[:, :, None])[..., 0] / along[:, None] + on_target)


def _columns(residual: Callable[[Floats], Floats], x: Floats, widths: tuple[int, ...]) -> Floats:
    """(parameters, m, 2) derivatives by central differences; a turn is taken on top of the one already there."""
    steps = np.repeat((*STEP, 1e-3), widths)
    made = []
    for i, h in enumerate(steps):
        ahead, behind = x.copy(), x.copy()
        ahead[i] += h
        behind[i] -= h
        if i < 3:
            axis = np.eye(3)[i] * h
            ahead[:3] = rotation.log(rotation.multiply(rotation.exp(axis), rotation.exp(x[:3])))
            behind[:3] = rotation.log(rotation.multiply(rotation.exp(-axis), rotation.exp(x[:3])))
        made.append((residual(ahead) - residual(behind)) / (2 * h))
    return np.array(made)


def _whitening(
    rays: SightRays, known: Known, poses: PoseTrack, frame: Ints, x: Floats, sigma: InstrumentSigma
) -> list[Floats]:
    """Per frame, the inverse of its covariance's Cholesky factor (2k, 2k)."""
    y = _targets_in_camera(rays, known, poses, frame, x)
    by_point = rays.pixel_from_ray / np.sum(rays.direction_cam * y, axis=1)[:, None, None]
    by_turn = -by_point @ rotation.skew(y) * sigma.attitude_rad
    own = np.concatenate([by_turn, by_point * sigma.position_m], axis=2)
    made = []
    for part, noise in zip(
        _split(own, frame, len(poses.frame)), _split(rays.sigma_px, frame, len(poses.frame)), strict=True
    ):
        flat = part.reshape(-1, 6)
        covariance = flat @ flat.T + np.diag(np.repeat(noise, 2) ** 2)
        made.append(np.linalg.inv(np.linalg.cholesky(covariance)))
    return made


def _split(values: Floats, frame: Ints, count: int) -> list[Floats]:
    """The rows of each frame; rows are in the order of frames."""
    return np.split(values, np.searchsorted(frame, np.arange(1, count)))


def _white(root: list[Floats], values: Floats, frame: Ints, count: int) -> Floats:
    parts = _split(values, frame, count)
    return np.concatenate([(L @ part.ravel()).reshape(-1, 2) for L, part in zip(root, parts, strict=True)])
