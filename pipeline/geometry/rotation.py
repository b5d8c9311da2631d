"""Rotations as unit quaternions (n, 4), scalar first, Hamilton: v_dst = q v_src q*.

Every function takes arrays of one quaternion (4,) or of many (n, 4) and broadcasts.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats

NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""North is ENU's second axis, east its first, down is minus up. Its own inverse."""

FRD_FROM_CAM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""A camera mounted with every angle zero: z looks forward, x is right, y is down."""


def normalised(q: Floats) -> Floats:
    """`q` at unit length."""
    q = np.asarray(q, float)
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))


def conjugate(q: Floats) -> Floats:
    """The inverse rotation: src_from_dst of dst_from_src."""
    return np.asarray(np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def multiply(a_from_b: Floats, b_from_c: Floats) -> Floats:
    """a_from_c: first `b_from_c`, then `a_from_b`."""
    a, b = np.asarray(a_from_b, float), np.asarray(b_from_c, float)
    aw, ax, ay, az = (a[..., i] for i in range(4))
    bw, bx, by, bz = (b[..., i] for i in range(4))
    q = np.empty((*np.broadcast_shapes(aw.shape, bw.shape), 4))
    q[..., 0] = aw * bw - (ax * bx + ay * by + az * bz)
    q[..., 1] = aw * bx + bw * ax + (ay * bz - az * by)
    q[..., 2] = aw * by + bw * ay + (az * bx - ax * bz)
    q[..., 3] = aw * bz + bw * az + (ax * by - ay * bx)
    return q


def rotate(dst_from_src: Floats, v_src: Floats) -> Floats:
    """Vectors (..., 3) turned from src into dst axes."""
    return np.asarray((matrix(dst_from_src) @ np.asarray(v_src, float)[..., None])[..., 0])


def matrix(q: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) (paper eq. 13)."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_matrix(m: Floats) -> Floats:
    """Quaternions (..., 4), w >= 0, of rotation matrices (..., 3, 3); the largest of the four is divided by."""
    m = np.asarray(m, float)
    d = np.diagonal(m, axis1=-2, axis2=-1)
    trace = d.sum(-1)
    squares = np.stack([1 + trace, *(1 - trace + 2 * d[..., i] for i in range(3))], axis=-1)
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    table = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], -1),
            np.stack([wx, squares[..., 1], xy, xz], -1),
            np.stack([wy, xy, squares[..., 2], yz], -1),
            np.stack([wz, xz, yz, squares[..., 3]], -1),
        ],
        axis=-2,
    )
    best = squares.argmax(-1)
    q = normalised(np.take_along_axis(table, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(q[..., :1] < 0, -q, q)


def exp(rotation_rad: Floats) -> Floats:
    """Quaternion of a rotation vector (..., 3): axis times angle."""
    half = 0.5 * np.asarray(rotation_rad, float)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), np.sinc(angle / np.pi) * half], axis=-1)


def log(q: Floats) -> Floats:
    """Rotation vector (..., 3) of a quaternion, shorter than or equal to pi."""
    q = np.asarray(q, float)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = np.arctan2(sine, q[..., :1])
    small = sine < 1e-12
    return np.asarray(2 * q[..., 1:] * np.where(small, 1.0, angle / np.where(small, 1.0, sine)))


def turn(dst_from_first: Floats, dst_from_second: Floats) -> Floats:
    """Rotation vector (..., 3) from one attitude to another, in axes of the first."""
    return log(multiply(conjugate(dst_from_first), dst_from_second))


def slerp(q0: Floats, q1: Floats, share: Floats) -> Floats:
    """The rotation a `share` (...,) of the shorter way from `q0` to `q1`, at constant angular rate."""
    step = log(multiply(q1, conjugate(q0)))
    return normalised(multiply(exp(np.asarray(share, float)[..., None] * step), q0))


def skew(v: Floats) -> Floats:
    """[v]x (..., 3, 3): skew(v) @ u = v x u."""
    v = np.asarray(v, float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def ned_from_frd(yaw_rad: Floats, pitch_rad: Floats, roll_rad: Floats) -> Floats:
    """Attitude (..., 4) of an FRD body, intrinsic Z-Y-X: yaw from north clockwise, pitch up, roll right wing down."""
    halves = [0.5 * np.asarray(angle, float) for angle in (yaw_rad, pitch_rad, roll_rad)]
    (cy, cp, cr), (sy, sp, sr) = ([f(half) for half in halves] for f in (np.cos, np.sin))
    q = np.empty((*np.broadcast_shapes(*(half.shape for half in halves)), 4))
    q[..., 0] = cy * cp * cr + sy * sp * sr
    q[..., 1] = cy * cp * sr - sy * sp * cr
    q[..., 2] = cy * sp * cr + sy * cp * sr
    q[..., 3] = sy * cp * cr - cy * sp * sr
    return q


def yaw_pitch_roll(ned_from_frd_q: Floats) -> Floats:
    """Yaw, pitch, roll (..., 3) in radians of an FRD attitude; the inverse of `ned_from_frd`."""
    m = matrix(ned_from_frd_q)
    return np.stack(
        [
            np.arctan2(m[..., 1, 0], m[..., 0, 0]),
            np.arcsin(np.clip(-m[..., 2, 0], -1, 1)),
            np.arctan2(m[..., 2, 1], m[..., 2, 2]),
        ],
        axis=-1,
    )


CAM_AS_FRD = from_matrix(FRD_FROM_CAM)
ENU_AS_NED = from_matrix(NED_FROM_ENU)


def enu_from_cam(ned_from_body: Floats, body_from_mount: Floats | None = None) -> Floats:
    """Camera attitude (..., 4) from the attitude of the FRD body it is mounted on.

    `body_from_mount` is the boresight as an FRD rotation (yaw, pitch, roll of the camera in the body); None is zero.
    """
    q = np.asarray(ned_from_body, float)
    if body_from_mount is not None:
        q = multiply(q, body_from_mount)
    return normalised(multiply(conjugate(ENU_AS_NED), multiply(q, CAM_AS_FRD)))


def camera_yaw_pitch_roll(enu_from_cam_q: Floats) -> Floats:
    """Yaw, pitch, roll (..., 3) in radians of a camera, the inverse of `enu_from_cam(ned_from_frd(...))`."""
    return yaw_pitch_roll(multiply(ENU_AS_NED, multiply(enu_from_cam_q, conjugate(CAM_AS_FRD))))
