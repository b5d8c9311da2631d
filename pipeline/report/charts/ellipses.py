"""Uncertainty as shapes: the ellipse {x : x' C^-1 x = k^2} of a 2 x 2 covariance, and how much to enlarge it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Trajectory
from pipeline.report.text.markup import number

FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def ellipse_path(centre_px: Floats, covariance_px: Floats, sigmas: float = 1.0) -> str:
    """SVG path data of one ellipse; `covariance_px` (2, 2) in the drawing's axes (y downwards). "" where unknown."""
    if not (np.isfinite(covariance_px).all() and np.isfinite(centre_px).all()):
        return ""
    values, vectors = np.linalg.eigh(covariance_px)
    minor, major = sigmas * np.sqrt(np.maximum(values, 0.0))
    along = vectors[:, 1] * major
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    x0, y0 = centre_px - along
    dx, dy = 2 * along
    arc = f"a{number(major, 1)} {number(minor, 1)} {number(angle, 1)} 1 0"
    return (
        f"M{number(x0, 1)} {number(y0, 1)}{arc} {number(dx, 1)} {number(dy, 1)}{arc} {number(-dx, 1)} {number(-dy, 1)}Z"
    )


def enlargement(trajectories: Sequence[Trajectory], px_per_m: float, wanted_px: float) -> int:
    """The round factor that gives a typical one-sigma a radius of about `wanted_px`, never below one.

    The largest ones, beyond the 95th percentile apart, stay below five times that.
    """
    sizes = [
        np.sqrt(np.maximum(np.linalg.eigvalsh(c[:, :2, :2])[:, 1], 0)) for c in map(_known, trajectories) if len(c)
    ]
    if not sizes:
        return 1
    pool = np.concatenate(sizes)
    typical = max(float(np.median(pool)), float(np.quantile(pool, 0.95)) / 5) * px_per_m
    fitting = [f for f in FACTORS if f * typical <= wanted_px]
    return fitting[-1] if fitting else 1


def _known(trajectory: Trajectory) -> Floats:
    covariance = trajectory.covariance
    return np.asarray(covariance[np.isfinite(covariance).all(axis=(1, 2))])
