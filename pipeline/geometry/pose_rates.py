"""How a camera turns and moves at each of its frames, from the poses around.

The rate at a frame is the difference of the poses a step before and after, over twice the step. A short step follows a
camera that swings; but poses whose noise is new in every frame want a long one, since what is wanted is how the camera
went on, not how the noise did. The noise is read off the poses' third differences, which smooth motion hardly has.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation

SHORTEST_S, LONGEST_S = 0.1, 0.5
"""Steps. A camera that swings with a period of 1 s keeps 94 % of its rate at the shortest, none at the longest."""
TURNING_RAD_S, MOVING_M_S = float(np.radians(1.0)), 0.5
"""Noise that a rate may have: half a readout of 20 ms later it is 0.01 degrees and 5 mm. Half of it asks for steps
twice as long."""
LIKELY = 1.645
"""Normal deviate that one absolute value in ten exceeds."""


def pose_rates(time_s: Floats, enu_from_cam: Floats, position_m: Floats) -> Floats:
    """(n, 6): rotation vector (camera axes, of cam_from_enu) and velocity, per second.

    Of poses at increasing times (n,): enu_from_cam (n, 4), position_m (n, 3).
    """
    n = len(time_s)
    out = np.zeros((n, 6))
    if n < 2:
        return out
    turns = rotation.log(_between(enu_from_cam, np.arange(n - 1), np.arange(1, n)))
    low, high = _around(time_s, _step_s(turns, TURNING_RAD_S))
    out[:, :3] = rotation.log(_between(enu_from_cam, low, high)) / _seconds(time_s, low, high)
    low, high = _around(time_s, _step_s(np.diff(position_m, axis=0), MOVING_M_S))
    out[:, 3:] = (position_m[high] - position_m[low]) / _seconds(time_s, low, high)
    return out


def _between(enu_from_cam: Floats, earlier: Ints, later: Ints) -> Floats:
    """Quaternions by which cam_from_enu turns from the poses `earlier` to those `later`."""
    return rotation.multiply(rotation.conjugate(enu_from_cam[later]), enu_from_cam[earlier])


def _step_s(first_differences: Floats, rate: float) -> float:
    """The step at which noise new in every pose makes a rate uncertain by no more than `rate`, within the limits."""
    third = np.diff(first_differences, n=2, axis=0)
    noise = float(np.quantile(np.abs(third), 0.9)) / (LIKELY * np.sqrt(20.0)) if len(third) else 0.0
    return float(np.clip(noise / (np.sqrt(2.0) * rate), SHORTEST_S, LONGEST_S))


def _around(time_s: Floats, step_s: float) -> tuple[Ints, Ints]:
    """Rows (n,) about a step before and after each; neighbours where poses are farther apart, itself at the ends."""
    n, margin = len(time_s), 1e-6 + step_s
    own = np.arange(n)
    low = np.minimum(np.searchsorted(time_s, time_s - margin), np.maximum(own - 1, 0))
    high = np.maximum(np.searchsorted(time_s, time_s + margin, side="right") - 1, np.minimum(own + 1, n - 1))
    return low, high


def _seconds(time_s: Floats, low: Ints, high: Ints) -> Floats:
    return np.asarray(np.maximum(time_s[high] - time_s[low], 1e-9)[:, None])
