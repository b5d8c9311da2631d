"""How rough measured poses are: more than that cannot be new in every frame.

A vehicle moves smoothly, so that noise which is new in every frame, or lasts a few, shows in the measured poses
themselves. With second differences over a lag of k frames

    d(i) = x(i - k) - 2 x(i) + x(i + k),    var d = 6 s^2  for white noise s of one axis,

to which real accelerations only add. A filter that tells a smooth path has errors all the same; they last.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Bools, Floats
from pipeline.geometry import rotation
from pipeline.records import PoseTrack

LAG_S = 0.3
"""What lasts longer is not new in every frame, and motions free to bend follow it. A third less, and the wobble of some
tenths of a second that attitude filters leave is taken for steps of poses; twice as much, and what lasts a second is
taken for noise, which draws targets towards the cameras (1 m in 10 s: 5 m off became 11)."""
MEDIAN = 2.366
"""Of chi-square with three degrees of freedom: a median bears the few frames of a turn or a step."""
FEWEST, EVEN = 20, 0.1
"""Second differences that tell, and by which share of the lag the two differences' times may be unequal."""


def roughness(poses: PoseTrack) -> tuple[float, float] | None:
    """Sigma per axis, of rotation (rad) and position (m), that may be new in every frame; None: too few frames."""
    time = poses.time_s
    if len(time) < FEWEST:
        return None
    k = max(1, round(LAG_S / max(float(np.median(np.diff(time))), 1e-9)))
    if len(time) < FEWEST + 2 * k:
        return None
    before, after = time[k:-k] - time[: -2 * k], time[2 * k :] - time[k:-k]
    even = np.abs(after - before) < EVEN * np.median(after)
    if even.sum() < FEWEST:
        return None
    place, q = poses.position_enu_m, poses.enu_from_cam
    bend = place[: -2 * k] - 2 * place[k:-k] + place[2 * k :]
    turn = rotation.turn(q[k:-k], q[2 * k :]) - rotation.turn(q[: -2 * k], q[k:-k])
    return _sigma(turn, even), _sigma(bend, even)


def _sigma(second: Floats, even: Bools) -> float:
    return float(np.sqrt(np.median((second[even] ** 2).sum(axis=1)) / MEDIAN / 6))
