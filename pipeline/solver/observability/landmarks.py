"""Landmarks and the ground in the question what can be known: unknown still points need parallax."""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.geometry import rotation
from pipeline.records import Problem

UNSURE = 0.5
"""Sigma over distance of an unknown landmark from which on it is not determined."""
ROUNDS = 5
"""Of weighting rays by the distance they turn out to have."""


def landmarks_known(problem: Problem) -> None:
    """Raises GeometryError where an unknown landmark's sight rays do not fix its distance."""
    for target in problem.targets:
        if target.landmark and (target.surveyed is None or target.check):
            centre, ray, sigma = _rays(problem, target.target)
            share = _unsure(centre, ray, sigma) if len(ray) > 1 else np.inf
            if not share < UNSURE:
                raise GeometryError(
                    where=f"target {target.target}",
                    seen=f"{len(ray)} sighting{'s' * (len(ray) != 1)} of a landmark at unknown place, whose rays leave "
                    + ("its distance open" if not np.isfinite(share) else f"{100 * share:.0f} % of its distance open"),
                    expected="sightings from places further apart, or its coordinates",
                    advice="mark it in more frames, or give lat, lon, height and sigma_m",
                )


def _rays(problem: Problem, name: str) -> tuple[Floats, Floats, Floats]:
    """Centres (m, 3), world rays (m, 3), sigmas (m,) of their directions."""
    centres, rays, sigmas = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)]
    for camera in problem.cameras:
        if name not in camera.rays.targets:
            continue
        own = camera.rays.target == camera.rays.targets.index(name)
        row = np.searchsorted(camera.poses.frame, camera.rays.frame[own])
        centres.append(camera.poses.position_enu_m[row])
        turn = rotation.matrix(camera.poses.enu_from_cam[row])
        rays.append((turn @ camera.rays.direction_cam[own][:, :, None])[..., 0])
        sigmas.append(np.hypot(camera.rays.sigma_rad[own], camera.sigma.attitude_rad))
    return np.concatenate(centres), np.concatenate(rays), np.concatenate(sigmas)


def _unsure(centre_m: Floats, ray: Floats, sigma_rad: Floats) -> float:
    """Greatest sigma of the place over its distance."""
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    weight = np.ones(len(ray))
    for _ in range(ROUNDS):
        normal = (across * weight[:, None, None]).sum(axis=0)
        if np.linalg.cond(normal) > 1e12:
            return np.inf
        place = np.linalg.solve(normal, (across @ centre_m[:, :, None])[..., 0].T @ weight)
        away = place - centre_m
        if not ((away * ray).sum(axis=1) > 0).all():
            return np.inf
        distance = np.linalg.norm(away, axis=1)
        weight = 1 / (distance * sigma_rad) ** 2
    return float(np.sqrt(np.linalg.eigvalsh(np.linalg.inv(normal))[-1]) / np.median(distance))
