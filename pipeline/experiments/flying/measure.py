"""An answer against the truth.

The paper's measure of a trajectory is the mean distance between found and true positions over all viewpoints: a
viewpoint is one sighting, its found position is where the found motion is at the found time of that frame, its true
position is where the target truly was when that frame was taken. So a wrong clock costs what it moves the target.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from calibration.foundation.arrays import Floats
from pipeline.experiments.flying.answers import Answer
from pipeline.records import Motion
from pipeline.synthetic.scene import Scene

MEASURES = (
    "error_m",  # mean length of the error over the viewpoints: the paper's measure
    "square_m2",  # mean square of the same
    "east_m2",  # mean squares by axis
    "north_m2",
    "up_m2",
    "offset_error_s",  # of the second camera
    "rate_error",  # relative, of the second camera
    "nees",  # normalised squared error of the motion's coefficients over their number
    "offset_sigmas",  # offset error over its claimed sigma
    "iterations",
    "converged",
    "seconds",  # of the whole call
    "solver_seconds",  # of the numerical solve alone
)


def place(name: str) -> int:
    """Column of a measure."""
    return MEASURES.index(name)


def measure(found: Answer | None, scene: Scene, target: int, seconds: float) -> Floats:
    """(measures,) of one answer; all NaN but `converged` (zero) and `seconds` where there is none."""
    out = np.full(len(MEASURES), np.nan)
    out[place("converged")], out[place("seconds")] = 0.0, seconds
    if found is None:
        return out
    square = viewpoint_errors(found, scene, target) ** 2
    length = square.sum(axis=1)
    out[place("error_m")] = np.sqrt(length).mean()
    out[place("square_m2")] = length.mean()
    out[place("east_m2") : place("up_m2") + 1] = square.mean(axis=0)
    out[place("nees")] = motion_nees(found.motion, scene, target)
    out[place("iterations")] = found.iterations
    out[place("converged")] = float(found.status == "converged")
    out[place("solver_seconds")] = found.seconds
    if len(scene.cameras) > 1:
        off = found.offset_s - scene.cameras[1].offset_s
        out[place("offset_error_s")] = off
        out[place("rate_error")] = found.frame_rate / scene.cameras[1].frame_rate - 1
        out[place("offset_sigmas")] = off / found.offset_sigma_s if found.offset_sigma_s > 0 else np.nan
    return out


def viewpoint_errors(found: Answer, scene: Scene, target: int) -> Floats:
    """Found minus true position (m, 3) at every viewpoint of a target."""
    true_s = np.empty(len(found.frame))
    for c, camera in enumerate(scene.cameras):
        own = found.camera == c
        true_s[own] = camera.frame_time_s(found.frame[own])
    return np.asarray(found.position_m - scene.targets[target].motion.position_enu_m(true_s))


def motion_nees(found: Motion, scene: Scene, target: int) -> float:
    """e' P^-1 e / 3 (K + 1) of a polynomial's coefficients, NaN where no covariance is known.

    Any K + 1 positions say as much as the coefficients, so e is taken there; P follows from the claimed covariance.
    """
    if found.covariance_band is None or found.kind != "polynomial":
        return float("nan")
    count = found.degree + 1
    time = np.linspace(found.start_s, found.end_s, count) if count > 1 else np.array([found.start_s])
    basis = BSpline(found.knots_s, np.eye(count), found.degree)(time)
    full = np.empty((count, 3, count, 3))
    for i in range(count):
        for j in range(count - i):
            full[i, :, i + j, :] = found.covariance_band[i, j]
            full[i + j, :, i, :] = found.covariance_band[i, j].T
    covariance = np.einsum("ai,ixjy,bj->axby", basis, full, basis).reshape(3 * count, 3 * count)
    error = (found.position_enu_m(time) - scene.targets[target].motion.position_enu_m(time)).ravel()
    try:
        return float(error @ np.linalg.solve(covariance, error)) / len(error)
    except np.linalg.LinAlgError:
        return float("nan")
