"""The camera model: pixels to directions and back.

Pinhole: x_px = K distort(X / Z, Y / Z); fisheye: x_px = K distort(theta). Both are OpenCV's, and OpenCV
computes them (`projectPoints`, `undistortPoints` and their `fisheye` twins).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import cv2
import numpy as np

from calibration.foundation.arrays import Floats, frozen, settle

Lens = Literal["pinhole", "fisheye"]
PINHOLE_TERMS = (0, 4, 5, 8, 12, 14)


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraModel:
    """Intrinsics and distortion of one camera.

    model       "pinhole" or "fisheye"
    image_size  (width, height) in pixels
    K           (3, 3), pixels
    distortion  (0, 4, 5, 8, 12 or 14,) for a pinhole, (4,) for a fisheye; OpenCV's order
    rms_px      reprojection error of the calibration, where known
    covariance  of (fx, fy, cx, cy, *distortion), where known
    made        how it was made: free words and figures that travel with the file
    """

    model: Lens = "pinhole"
    image_size: tuple[int, int]
    K: Floats
    distortion: Floats
    rms_px: float | None = None
    covariance: Floats | None = None
    made: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settle(
            self,
            K=frozen(self.K, (3, 3), "K"),
            distortion=frozen(np.ravel(self.distortion), (None,), "distortion"),
            image_size=(int(self.image_size[0]), int(self.image_size[1])),
            made=MappingProxyType(dict(self.made)),
        )
        allowed = (4,) if self.model == "fisheye" else PINHOLE_TERMS
        if len(self.distortion) not in allowed:
            raise ValueError(f"distortion: {len(self.distortion)} terms, expected one of {allowed}")
        if self.covariance is not None:
            n = 4 + len(self.distortion)
            settle(self, covariance=frozen(self.covariance, (n, n), "covariance"))


def area_matrix(K: Floats, corner_px: tuple[float, float], scale: tuple[float, float]) -> Floats:
    """K (3, 3) of a part of the picture that begins at `corner_px` (whole pixels from the top left), then scaled.

    Pixel edges stay pixel edges: x' + 1/2 = (x + 1/2 - corner) scale.
    """
    moved = np.diag([scale[0], scale[1], 1.0]) @ K
    for axis in (0, 1):
        moved[axis, 2] = (K[axis, 2] + 0.5 - corner_px[axis]) * scale[axis] - 0.5
    return moved


def project(camera: CameraModel, points_cam: Floats) -> Floats:
    """Pixels (n, 2) of points (n, 3) in camera axes, any unit of length; points behind the camera give NaN."""
    points = np.asarray(points_cam, float).reshape(-1, 3)
    front = points[:, 2] > 0
    pixels = np.full((len(points), 2), np.nan)
    if front.any():
        ahead = np.ascontiguousarray(points[front]).reshape(-1, 1, 3)
        zero = np.zeros(3)
        if camera.model == "fisheye":
            found, _ = cv2.fisheye.projectPoints(ahead, zero, zero, camera.K, camera.distortion)
        else:
            found, _ = cv2.projectPoints(ahead, zero, zero, camera.K, camera.distortion)
        pixels[front] = found.reshape(-1, 2)
    return pixels


def unproject(camera: CameraModel, pixels: Floats) -> Floats:
    """Unit directions (n, 3) in camera axes of pixels (n, 2): the lens removed (paper eq. 4 without R).

    A pixel that no direction maps to (outside of what the distortion can reach) gives NaN.
    """
    px = np.ascontiguousarray(np.asarray(pixels, float).reshape(-1, 1, 2))
    if len(px) == 0:
        return np.empty((0, 3))
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    if camera.model == "fisheye":
        flat = cv2.fisheye.undistortPoints(px, camera.K, camera.distortion, criteria=stop)
    else:
        flat = cv2.undistortPoints(px, camera.K, camera.distortion, None, None, None, stop)
    rays = np.concatenate([flat.reshape(-1, 2), np.ones((len(px), 1))], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    back = project(camera, rays)
    rays[~(np.abs(back - px[:, 0]).max(axis=1) < 0.01)] = np.nan
    return rays


FOCAL_STEP, ON_AXIS = 0.02, 1e-3
"""Change of ln f over which its effect is told; tangent up to which a ray lies on the axis, where no lens distorts."""


def focal_effect(camera: CameraModel, rays: Floats) -> Floats:
    """(n, 2) what a change of both focal lengths does to the sight rays of pixels that now have the directions `rays`.

    With K's focal lengths multiplied by exp(phi), ln of the tangent of a ray's angle to the axis falls by
    a phi + b phi^2 / 2; returns (a, b). Without distortion that is (1, 0); a barrel-shaped lens (k1 < 0) has a > 1, as
    near its edge the angle grows faster than the pixel's distance. By differences of `unproject`.
    """
    unit = np.asarray(rays, float).reshape(-1, 3)
    centre = camera.K[:2, 2]
    off = project(camera, unit) - centre
    at = np.hypot(unit[:, 0], unit[:, 1]) / unit[:, 2]
    out = np.tile([1.0, 0.0], (len(unit), 1))
    use = at > ON_AXIS

    def tangent(phi: float) -> Floats:
        found = unproject(camera, centre + off[use] * np.exp(-phi))
        return np.log(np.hypot(found[:, 0], found[:, 1]) / found[:, 2])

    middle, longer, shorter = np.log(at[use]), tangent(FOCAL_STEP), tangent(-FOCAL_STEP)
    both = np.stack([shorter - longer, (2 * middle - shorter - longer) / (0.5 * FOCAL_STEP)], axis=1) / (2 * FOCAL_STEP)
    # at the very edge of what the distortion can reach there is nothing outside
    one_sided = np.stack([(middle - longer) / FOCAL_STEP, np.zeros(len(middle))], axis=1)
    out[use] = np.where(np.isfinite(shorter)[:, None], both, one_sided)
    return out


def pixel_from_ray(camera: CameraModel, rays: Floats) -> Floats:
    """Jacobian (n, 2, 3) of pixels with respect to a change of the direction `rays` (n, 3), in px / rad.

    J d = 0: a change of length moves no pixel. By central differences of `project`.
    """
    unit = np.asarray(rays, float).reshape(-1, 3)
    step = 1e-6
    columns = []
    for axis in np.eye(3):
        ahead, behind = project(camera, unit + step * axis), project(camera, unit - step * axis)
        columns.append((ahead - behind) / (2 * step))
    jacobian = np.stack(columns, axis=2)
    return np.asarray(jacobian - (jacobian @ unit[:, :, None]) * unit[:, None, :])
