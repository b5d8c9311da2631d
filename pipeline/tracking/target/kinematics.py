"""Where a target should be next: constant velocity over the ground, seen through a camera that moves.

State: position p and velocity v (px/s) in the image, both axes with the same 2 x 2 covariance P. The background's
motion carries it to the next frame, p <- H(p + v dt), v <- J v with J the Jacobian of H, and white acceleration of
spectral density q enters. A fix updates it (Kalman filter).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.scene.background import moved

ACCELERATION_SIZES = 2.0  # target lengths per second squared, held for PERSISTENCE_S
PERSISTENCE_S = 0.3
FIRST_SPEED_SIZES = 4.0  # target lengths per second, one sigma


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """Position (2,) px, velocity (2,) px/s, their covariance (2, 2) for each axis, target's length in px."""

    position_px: Floats
    velocity: Floats
    covariance: Floats
    length_px: float

    @property
    def sigma_px(self) -> float:
        """Of the position, per axis."""
        return math.sqrt(self.covariance[0, 0])


def first_course(position_px: Floats, length_px: float) -> Course:
    """A target just seen for the first time, speed unknown."""
    speed = FIRST_SPEED_SIZES * length_px
    return Course(
        position_px=np.asarray(position_px, float),
        velocity=np.zeros(2),
        covariance=np.diag([0.1**2, speed**2]),
        length_px=length_px,
    )


def carried(course: Course, cur_from_prev: Floats, dt_s: float) -> tuple[Course, Floats]:
    """The course one frame later, and the background's Jacobian (2, 2) there."""
    to, jacobian = moved(cur_from_prev, course.position_px + course.velocity * dt_s)
    (a, b), (c, d) = jacobian.tolist()
    area = abs(a * d - b * c)
    density = (ACCELERATION_SIZES * course.length_px) ** 2 * PERSISTENCE_S
    (pp, pv), (_, vv) = course.covariance.tolist()
    place = pp + dt_s * (2 * pv + dt_s * vv) + density * dt_s**3 / 3
    mixed, speed = pv + dt_s * vv + density * dt_s**2 / 2, vv + density * dt_s
    later = Course(
        position_px=to,
        velocity=jacobian @ course.velocity,
        covariance=area * np.array([[place, mixed], [mixed, speed]]),
        length_px=course.length_px * math.sqrt(area),
    )
    return later, jacobian


def corrected(course: Course, position_px: Floats, sigma_px: float) -> Course:
    """The course after a fix."""
    gain = course.covariance[:, 0] / (course.covariance[0, 0] + sigma_px**2)
    error = position_px - course.position_px
    return Course(
        position_px=course.position_px + gain[0] * error,
        velocity=course.velocity + gain[1] * error,
        covariance=course.covariance - np.outer(gain, course.covariance[0]),
        length_px=course.length_px,
    )
