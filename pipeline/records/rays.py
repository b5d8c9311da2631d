"""What a camera saw, with the lens removed: directions in camera axes, each at its own time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints, frozen, settle


@dataclass(frozen=True, kw_only=True, eq=False)
class SightRays:
    """All sightings of one camera, ordered by frame, then target. Pose and clock are not applied yet.

    targets         names; `target` (m,) indexes them
    frame           (m,) non-decreasing
    time_s          (m,) video time
    direction_cam   (m, 3) unit vectors in camera axes (paper eq. 4 before R)
    pixel_from_ray  (m, 2, 3) Jacobian of the pixel with respect to the direction, px / rad; pixel_from_ray @ d = 0
    sigma_px        (m,) of the pixel, per axis
    focal_effect    (m, 2) or None: (a, b), by how much a phi + b phi^2 / 2 the log of the tangent of a ray's angle to
                    the axis falls when focal lengths grow by exp(phi); None: (1, 0), a lens without distortion
    place_sigma_px  (2,) one sigma per axis of where the tracked point sits on its target, as this camera sees it: a
                    constant part, and a part that drifts linearly from minus to plus its value while the camera looks.
                    Zero: the same physical point in every camera and at any time
    row             (m,) or None: where the sighting's row is in its frame, from -1/2 at the first to 1/2 at the last

    A point y in camera axes (metres, ahead of the camera) has, to first order and exactly at zero, the reprojection
    error pixel_from_ray @ y / (d . y) pixels; divided by sigma_px it is the residual of every statistical method.
    """

    camera: str
    targets: tuple[str, ...]
    target: Ints
    frame: Ints
    time_s: Floats
    direction_cam: Floats
    pixel_from_ray: Floats
    sigma_px: Floats
    focal_effect: Floats | None = None
    place_sigma_px: tuple[float, float] = (0.0, 0.0)
    row: Floats | None = None

    def __post_init__(self) -> None:
        m = len(self.frame)
        frame = frozen(self.frame, (m,), "frame", np.int64)
        if np.any(np.diff(frame) < 0):
            raise ValueError(f"rays of {self.camera}: frames must not decrease")
        settle(
            self,
            targets=tuple(self.targets),
            target=frozen(self.target, (m,), "target", np.int64),
            frame=frame,
            time_s=frozen(self.time_s, (m,), "time_s"),
            direction_cam=frozen(self.direction_cam, (m, 3), "direction_cam"),
            pixel_from_ray=frozen(self.pixel_from_ray, (m, 2, 3), "pixel_from_ray"),
            sigma_px=frozen(self.sigma_px, (m,), "sigma_px"),
            focal_effect=None if self.focal_effect is None else frozen(self.focal_effect, (m, 2), "focal_effect"),
            row=None if self.row is None else frozen(self.row, (m,), "row"),
        )

    def some(self, rows: Bools | Ints) -> SightRays:
        """Some of the sightings, by a mask or in the order of their numbers."""
        return replace(
            self, target=self.target[rows], frame=self.frame[rows], time_s=self.time_s[rows],
            direction_cam=self.direction_cam[rows], pixel_from_ray=self.pixel_from_ray[rows],
            sigma_px=self.sigma_px[rows], focal_effect=None if self.focal_effect is None else self.focal_effect[rows],
            row=None if self.row is None else self.row[rows],
        )  # fmt: skip

    @property
    def sigma_rad(self) -> Floats:
        """(m,) the angle that one sigma_px covers, geometric mean over the two directions."""
        gram = self.pixel_from_ray @ np.swapaxes(self.pixel_from_ray, 1, 2)
        return np.asarray(self.sigma_px / np.linalg.det(gram) ** 0.25)
