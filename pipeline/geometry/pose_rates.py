"""How a camera turns and moves at each of its frames, from the poses around.

Through the poses of a window about a frame a cubic is laid, rotations as vectors from the frame's own; its slope there
is the rate. A short window follows a camera that shakes; but poses whose noise is new in every frame want a long one,
since what is wanted is how the camera went on, not how the noise did. The noise is read off the poses' third
differences, which smooth motion hardly has.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry import rotation

SHORTEST_S, LONGEST_S = 0.1, 1.0
"""Half windows. A camera that swings with a period of 1 s keeps 99 % of its rate at 0.2 s and 60 % at 0.5 s."""
FEWEST, MOST, DEGREE = 2, 30, 3
"""Poses on either side: the fewest a cubic takes, and the most that are looked at."""
TURNING_RAD_S, MOVING_M_S = float(np.radians(1.0)), 0.5
"""Noise that a rate may have: half a readout of 20 ms later it is 0.01 degrees and 5 mm. Half of it asks for windows
1.6 times as long."""
LIKELY = 1.645
"""Normal deviate that one absolute value in ten exceeds."""
SPREAD = 3.06
"""Noise of a cubic's slope, for poses dt apart with noise sigma in a half window h: SPREAD sigma sqrt(dt) / h^1.5."""
CHUNK = 8192
"""Frames whose windows are held at once."""


def pose_rates(time_s: Floats, enu_from_cam: Floats, position_m: Floats) -> Floats:
    """(n, 6): rotation vector (camera axes, of cam_from_enu) and velocity, per second.

    Of poses at increasing times (n,): enu_from_cam (n, 4), position_m (n, 3).
    """
    n = len(time_s)
    out = np.zeros((n, 6))
    if n < 2 or not np.ptp(time_s) > 0:
        return out
    dt = float(np.median(np.diff(time_s)))
    turns = rotation.log(_between(enu_from_cam[1:], enu_from_cam[:-1]))
    for low in range(0, n, CHUNK):
        own = np.arange(low, min(low + CHUNK, n))
        rows, half_s = _window(own, n, dt, _half_s(turns, dt, TURNING_RAD_S))
        turned = rotation.log(_between(enu_from_cam[rows], enu_from_cam[own][:, None]))
        out[own, :3] = _slope(time_s[rows] - time_s[own][:, None], turned, half_s)
        rows, half_s = _window(own, n, dt, _half_s(np.diff(position_m, axis=0), dt, MOVING_M_S))
        moved = position_m[rows] - position_m[own][:, None]
        out[own, 3:] = _slope(time_s[rows] - time_s[own][:, None], moved, half_s)
    return out


def _between(later: Floats, earlier: Floats) -> Floats:
    """Quaternions by which cam_from_enu turns from the poses `earlier` to those `later`, both enu_from_cam."""
    return rotation.multiply(rotation.conjugate(later), earlier)


def _half_s(first_differences: Floats, dt: float, rate: float) -> float:
    """The half window in which noise new in every pose makes a rate uncertain by no more than `rate`, if it may be."""
    third = np.diff(first_differences, n=2, axis=0)
    noise = float(np.quantile(np.abs(third), 0.9)) / (LIKELY * np.sqrt(20.0)) if len(third) else 0.0
    return float(np.clip((SPREAD * noise * np.sqrt(dt) / rate) ** (2 / 3), SHORTEST_S, LONGEST_S))


def _window(own: Ints, n: int, dt: float, half_s: float) -> tuple[Ints, float]:
    """Rows (m, w) about each of `own`, and the half window that they make."""
    side = int(np.clip(round(half_s / dt), FEWEST, MOST))
    wide = min(2 * side + 1, n)
    first = np.clip(own - side, 0, n - wide)
    return first[:, None] + np.arange(wide), side * dt


def _slope(time_s: Floats, value: Floats, half_s: float) -> Floats:
    """(m, 3) slope at time zero of cubics through values (m, w, 3) at times (m, w); those over gaps count less."""
    u = time_s / half_s
    degree = min(DEGREE, time_s.shape[1] - 1)
    powers = u[..., None] ** np.arange(degree + 1)
    weighted = powers / (1 + (u / 2) ** 8)[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ powers
    normal += 1e-9 * np.eye(degree + 1)
    return np.asarray(np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ value)[:, 1] / half_s)
