"""Numbers that no flight can have are refused before the mathematics meets them."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import CameraInput, Problem

FARTHEST_M, LONGEST_S = 1e8, 1e7
"""Further than any two places on Earth; longer than any flight: four months."""
SLOWEST_HZ, FASTEST_HZ = 1e-4, 1e6
LONGEST_READOUT_S = 10.0
LEAST_PX, MOST_PX = 1e-6, 1e6
MOST_SIGMA = 1e9
SIGMAS = (
    "attitude_bias_rad", "attitude_rad", "position_bias_m", "position_m", "frame_rate", "focal", "start_s", "readout_s",
)  # fmt: skip


def check_magnitudes(problem: Problem) -> None:
    """Raises GeometryError where a number of the problem is not finite, or beyond what a flight can have."""
    for camera in problem.cameras:
        name, sigma = f"camera {camera.camera}", camera.sigma
        rate = camera.frame_rate
        if not SLOWEST_HZ <= rate <= FASTEST_HZ:
            raise _refused(f"{name}: frame_rate", f"{rate:.3g} Hz", f"{SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
        _within(f"{name}: positions", camera.poses.position_enu_m, FARTHEST_M, "m")
        _within(f"{name}: attitudes", camera.poses.enu_from_cam, 1.0 + 1e-6, "in a unit quaternion")
        _within(f"{name}: video times", camera.rays.time_s, LONGEST_S, "s")
        _within(f"{name}: readout_s", np.array([camera.readout_s]), LONGEST_READOUT_S, "s")
        _within(f"{name}: offset_s", np.array([camera.offset_s or 0.0]), LONGEST_S, "s")
        _check_sightings(name, camera)
        for key in SIGMAS:
            _within(f"{name}: sigma.{key}", np.array([getattr(sigma, key)]), MOST_SIGMA, "")


def _check_sightings(name: str, camera: CameraInput) -> None:
    sigma = camera.rays.sigma_px
    if len(sigma) and not (np.isfinite(sigma) & (sigma >= LEAST_PX) & (sigma <= MOST_PX)).all():
        worst = sigma[np.abs(np.log(np.clip(np.nan_to_num(sigma), 1e-300, 1e300))).argmax()]
        raise _refused(f"{name}: sigma_px", f"{worst:.3g} px", f"{LEAST_PX:g} to {MOST_PX:g} px")
    _within(f"{name}: sight rays", camera.rays.direction_cam, 1.0 + 1e-6, "in a unit vector")
    _within(f"{name}: pixels per radian", camera.rays.pixel_from_ray, 1e12, "")


def _within(where: str, value: Floats, most: float, unit: str) -> None:
    wrong = ~(np.abs(value) <= most)
    if wrong.any():
        raise _refused(where, f"{value[wrong].flat[0]:.3g} {unit}".strip(), f"at most {most:.3g} {unit}".strip())


def _refused(where: str, seen: str, expected: str) -> GeometryError:
    return GeometryError(
        where=where, seen=seen, expected=expected,
        advice="look at the file that it comes from: its units, its columns, a missing value written as a number",
    )  # fmt: skip
