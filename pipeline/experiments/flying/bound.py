"""The least error any method can have: the Bayesian Cramer-Rao bound, computed apart from the solver.

At the truth, with y = R (X - C) in camera axes and P the pixel's derivative by the direction, a sighting obeys

    dx = P (R dX(t) - R dp + w x y) / |y| + pixel noise        dX(t) = sum B_k(t) da_k + V dt,  dt = dbeta + tau ds

Motion coefficients a, offsets beta and scales s of the frame period are unknown, and so are each camera's constant
rotation and position errors. What is drawn anew for each frame (rotation, position, pixel) is noise: with A_f the
derivatives by the frame's own pose and L its prior covariance, the pixels of one frame have the covariance
S_f = sigma^2 I + A_f L A_f', and

    information = sum_f J_f' S_f^-1 J_f + priors,      bound = its inverse.

The solver eliminates the frames' errors in the information form; this is the covariance form of the same statement.
The bound says what is possible on average over errors drawn as the priors say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from calibration.camera import pixel_from_ray
from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.experiments.declare import Spell
from pipeline.geometry import rotation
from pipeline.synthetic.scene import Scene, camera_pose, pixels_of, visible
from pipeline.synthetic.simulate import Noise

BIAS = 6
CLOCK = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraRows:
    """A camera's sightings at the truth, dense over frames f and targets n.

    time_s, video_s (f,); seen (f, n); by_position (f, n, 2, 3) pixels by the target's ENU position;
    by_pose (f, n, 2, 6) pixels by rotation (camera axes) and position (ENU) of the camera; velocity (f, n, 3);
    distance_m (f, n)
    """

    time_s: Floats
    video_s: Floats
    seen: Bools
    by_position: Floats
    by_pose: Floats
    velocity: Floats
    distance_m: Floats


def camera_rows(scene: Scene, number: int, hidden: Sequence[Spell] = ()) -> CameraRows:
    """Derivatives of every sighting of one camera at the truth."""
    camera = scene.cameras[number]
    frame: Ints = np.arange(camera.frames)
    time = camera.frame_time_s(frame)
    centre, enu_from_cam = camera_pose(camera.platform, time)
    cam_from_enu = rotation.matrix(rotation.conjugate(enu_from_cam))
    points = np.stack([t.motion.position_enu_m(time) for t in scene.targets], axis=1)
    velocity = np.stack([t.motion.position_enu_m(time, 1) for t in scene.targets], axis=1)
    y = np.einsum("fij,fnj->fni", cam_from_enu, points - centre[:, None])
    distance = np.linalg.norm(y, axis=-1)
    shape = distance.shape
    direction = (y / distance[..., None]).reshape(-1, 3)
    flat = pixel_from_ray(camera.lens, direction).reshape(*shape, 2, 3) / distance[..., None, None]
    by_position = np.einsum("fnij,fjk->fnik", flat, cam_from_enu)
    by_turn = np.cross(y[..., None, :], flat)  # row by row, P (w x y) = w . (y x P)
    seen = np.empty(shape, dtype=bool)
    for n in range(shape[1]):
        pixels, _ = pixels_of(camera, frame, points[:, n])
        seen[:, n] = visible(scene, camera, pixels, centre, points[:, n])
    for spell in hidden:
        if spell.camera == number:
            seen[spell.first : spell.last, spell.target] = False
    return CameraRows(
        time_s=time, video_s=frame / camera.nominal_rate, seen=seen, by_position=by_position,
        by_pose=np.concatenate([by_turn, -by_position], axis=-1), velocity=velocity, distance_m=distance,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Unknowns:
    """Places of the unknowns: motion of each target (a slice per target), clock and bias of each camera."""

    motion: tuple[slice, ...]
    orders: tuple[int, ...]
    span_s: tuple[float, float]
    clock: tuple[slice, ...]
    bias: tuple[slice, ...]
    count: int

    def basis(self, target: int, time_s: Floats) -> Floats:
        """(m, K + 1) powers of time, scaled to -1 .. 1 over the flight."""
        low, high = self.span_s
        u = (2 * time_s - low - high) / (high - low)
        return np.asarray(u[:, None] ** np.arange(self.orders[target] + 1))

    def by_motion(self, target: int, time_s: Floats) -> Floats:
        """(m, 3, 3 (K + 1)) derivative of the position by the coefficients, axis by axis."""
        basis = self.basis(target, time_s)
        return np.asarray(np.einsum("mk,ij->mijk", basis, np.eye(3)).reshape(len(time_s), 3, -1))


def unknowns(scene: Scene) -> Unknowns:
    """All unknowns of a scene whose targets move along polynomials."""
    orders = tuple(t.motion.degree for t in scene.targets)
    at, motion, clock, bias = 0, [], [], []
    for order in orders:
        motion.append(slice(at, at := at + 3 * (order + 1)))
    for _ in scene.cameras:
        clock.append(slice(at, at := at + CLOCK))
        bias.append(slice(at, at := at + BIAS))
    return Unknowns(
        motion=tuple(motion), orders=orders, span_s=scene.span_s, clock=tuple(clock), bias=tuple(bias), count=at
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Bound:
    """The bound's covariance (q, q) of all unknowns; what is held has zero rows.

    determined  false: the data and priors leave a direction free
    """

    unknowns: Unknowns
    covariance: Floats
    determined: bool
    viewpoints: tuple[Floats, ...]

    def offset_sigma_s(self, camera: int) -> float:
        """Of a camera's offset: its common time at video time zero."""
        return float(np.sqrt(self.covariance[self.unknowns.clock[camera].start, self.unknowns.clock[camera].start]))

    def rate_sigma(self, camera: int) -> float:
        """Of a camera's frame rate, relative."""
        place = self.unknowns.clock[camera].start + 1
        return float(np.sqrt(self.covariance[place, place]))

    def rms_m(self, target: int = 0) -> float:
        """Root mean square of the 3D error over all viewpoints of a target."""
        return float(np.sqrt(np.trace(self.viewpoints[target], axis1=1, axis2=2).mean()))

    def rms_by_axis_m(self, target: int = 0) -> Floats:
        """(3,) the same for east, north, up."""
        return np.asarray(np.sqrt(np.diagonal(self.viewpoints[target], axis1=1, axis2=2).mean(axis=0)))

    def mean_m(self, target: int = 0) -> float:
        """Mean length of the 3D error over all viewpoints, of errors with a normal distribution."""
        return float(mean_length(self.viewpoints[target]).mean())


def camera_jacobian(rows: CameraRows, who: Unknowns, camera: int) -> Floats:
    """(f, n, 2, q) of a camera's pixels by all unknowns."""
    f, n = rows.seen.shape
    out = np.zeros((f, n, 2, who.count))
    moved = np.einsum("fnij,fnj->fni", rows.by_position, rows.velocity)
    for target in range(n):
        by_motion = who.by_motion(target, rows.time_s)
        out[:, target, :, who.motion[target]] = rows.by_position[:, target] @ by_motion
    clock = who.clock[camera].start
    out[..., clock] = moved
    out[..., clock + 1] = moved * rows.video_s[:, None, None]
    out[..., who.bias[camera]] = rows.by_pose
    return out


def frame_covariance(rows: CameraRows, noise: Noise) -> Floats:
    """(f, 2 n, 2 n) of a frame's pixels: white noise and the frame's own pose error."""
    f, n = rows.seen.shape
    pose = rows.by_pose.reshape(f, 2 * n, BIAS) * np.repeat([noise.attitude_rad, noise.position_m], 3)
    return np.asarray(pose @ np.swapaxes(pose, 1, 2) + noise.pixel_px**2 * np.eye(2 * n))


def free_unknowns(scene: Scene, who: Unknowns, noise: Noise, *, refine_frame_rate: bool = True) -> tuple[Bools, Floats]:
    """Which unknowns are free (q,), and the precision of their priors (q,)."""
    free, precision = np.zeros(who.count, dtype=bool), np.zeros(who.count)
    for part in who.motion:
        free[part] = True
    sigma = np.repeat([noise.attitude_bias_rad, noise.position_bias_m], 3)
    for c in range(len(scene.cameras)):
        free[who.bias[c]] = sigma > 0
        precision[who.bias[c]] = np.where(sigma > 0, 1 / np.where(sigma > 0, sigma, 1.0) ** 2, 0.0)
        if c > 0:
            start = who.clock[c].start
            free[start] = noise.offset_s is None or noise.offset_s > 0
            precision[start] = 1 / noise.offset_s**2 if noise.offset_s else 0.0
            free[start + 1] = refine_frame_rate and noise.frame_rate_prior > 0
            precision[start + 1] = 1 / noise.frame_rate_prior**2 if noise.frame_rate_prior > 0 else 0.0
    return free, precision


def information(scene: Scene, noise: Noise, who: Unknowns, rows: Sequence[CameraRows]) -> Floats:
    """(q, q) that the sightings alone give."""
    total = np.zeros((who.count, who.count))
    for c, own in enumerate(rows):
        jacobian, covariance = camera_jacobian(own, who, c), frame_covariance(own, noise)
        seen = np.repeat(own.seen, 2, axis=1)
        rows_of = jacobian.reshape(*seen.shape, who.count) * seen[..., None]
        both = seen[:, :, None] & seen[:, None, :]
        kept = np.where(both, covariance, np.eye(seen.shape[1]))  # what is not seen has no row and disturbs none
        total += np.einsum("fri,frj->ij", rows_of, np.linalg.solve(kept, rows_of), optimize=True)
    return total


def bound(scene: Scene, noise: Noise, *, hidden: Sequence[Spell] = (), refine_frame_rate: bool = True) -> Bound:
    """The bound of a scene under a noise, for targets on polynomials and clocks of constant rate."""
    who, rows = unknowns(scene), [camera_rows(scene, c, hidden) for c in range(len(scene.cameras))]
    free, precision = free_unknowns(scene, who, noise, refine_frame_rate=refine_frame_rate)
    normal = (information(scene, noise, who, rows) + np.diag(precision))[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    scaled = normal * scale[:, None] * scale
    values = np.linalg.eigvalsh(scaled)
    covariance = np.zeros((who.count, who.count))
    covariance[np.ix_(free, free)] = np.linalg.pinv(scaled, hermitian=True) * scale[:, None] * scale
    return Bound(
        unknowns=who, covariance=covariance, determined=bool(values[0] > 1e-11 * values[-1]),
        viewpoints=viewpoint_covariances(who, rows, covariance),
    )  # fmt: skip


def viewpoint_jacobians(who: Unknowns, rows: Sequence[CameraRows], target: int) -> Floats:
    """(m, 3, q) of the estimated position at every sighting's estimated time: motion and clock both move it."""
    parts = []
    for c, own in enumerate(rows):
        seen = own.seen[:, target]
        time, video, velocity = own.time_s[seen], own.video_s[seen], own.velocity[seen, target]
        part = np.zeros((len(time), 3, who.count))
        part[:, :, who.motion[target]] = who.by_motion(target, time)
        start = who.clock[c].start
        part[:, :, start] = velocity
        part[:, :, start + 1] = velocity * video[:, None]
        parts.append(part)
    return np.concatenate(parts)


def viewpoint_covariances(who: Unknowns, rows: Sequence[CameraRows], covariance: Floats) -> tuple[Floats, ...]:
    """Per target (m, 3, 3) of the position at every viewpoint."""
    out = []
    for target in range(len(who.motion)):
        by = viewpoint_jacobians(who, rows, target)
        out.append(np.asarray(by @ covariance @ np.swapaxes(by, 1, 2)))
    return tuple(out)


@cache
def _nodes() -> tuple[Floats, Floats]:
    """Nodes q and weights of the integral over q = sqrt(s) from zero to infinity."""
    node, weight = np.polynomial.legendre.leggauss(80)
    x = (node + 1) / 2
    return x / (1 - x), weight / 2 / (1 - x) ** 2


def mean_length(covariance: Floats) -> Floats:
    """Mean length (m,) of normal vectors of zero mean and covariances (m, 3, 3), by one integral.

    E|e| = (1 / 2 sqrt(pi)) int_0^inf (1 - prod (1 + 2 s v_i)^-1/2) s^-3/2 ds, v_i the eigenvalues; with s = q^2 in
    units of the trace.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    total = np.maximum(values.sum(axis=1), 1e-300)
    q, weight = _nodes()
    share = values / total[:, None]
    drop = 1 - np.prod(1 / np.sqrt(1 + 2 * q[:, None] ** 2 * share[:, None, :]), axis=2)
    return np.asarray((drop * (weight / q**2)).sum(axis=1) * np.sqrt(total / np.pi))
