"""Clocks: t = tau (1 + s) + beta + deviation(tau), the paper's eq. 2 written about the given frame rate.

tau is video time, alpha = given rate / (1 + s), beta the offset. The deviation of a drifting clock is linear between
knots, so that inside one of its segments common time is a straight line in tau like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.observation.observations import Frames

ROT, POS, FOCAL, OFFSET, SCALE, START, READOUT = slice(0, 3), slice(3, 6), 6, 7, 8, 9, 10
CAMERA_PARAMETERS = 11
"""Columns of a camera's constant parameters: rotation bias, position bias, log focal scale, offset, scale, start, and
the rolling shutter's readout (the whole of it, not a correction).


Where tracked points may sit elsewhere on their targets than the other cameras see them (`SightRays.place_sigma_px`),
four more for each target: x constant, x drifting, y constant, y drifting, in pixels.
"""
PLACE_PARAMETERS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Drift:
    """Knots of the deviations of all drifting clocks, one camera's after another.

    first   (C + 1,) where each camera's knots begin; a camera without drift has none
    knot_s  (D,) video time
    segment (F,) index into the knots of the segment's left end; -1 where the camera has no drift
    """

    first: Ints
    knot_s: Floats
    segment: Ints

    @property
    def count(self) -> int:
        """Knots in all."""
        return len(self.knot_s)

    def of(self, camera: int) -> slice:
        """The knots of one camera."""
        return slice(int(self.first[camera]), int(self.first[camera + 1]))


def without_drift(frames: Frames) -> Drift:
    """Affine clocks only."""
    cameras = len(frames.cameras)
    return Drift(
        first=np.zeros(cameras + 1, dtype=np.int64),
        knot_s=np.empty(0),
        segment=np.full(frames.count, -1, dtype=np.int64),
    )


def drift_knots(frames: Frames, spacing_s: dict[int, float]) -> Drift:
    """Knots about every `spacing_s[camera]` seconds over that camera's video, for the cameras it names."""
    first, knots, segment = [0], [], np.full(frames.count, -1, dtype=np.int64)
    for camera in range(len(frames.cameras)):
        own: Floats = np.empty(0)
        if camera in spacing_s:
            tau = frames.video_s[frames.of(camera)]
            pieces = max(1, round((tau.max() - tau.min()) / spacing_s[camera]))
            own = np.linspace(tau.min(), tau.max(), pieces + 1)
            left = np.clip(np.searchsorted(own, tau, side="right") - 1, 0, pieces - 1)
            segment[frames.of(camera)] = first[-1] + left
        knots.append(own)
        first.append(first[-1] + len(own))
    return Drift(first=np.array(first, dtype=np.int64), knot_s=np.concatenate(knots), segment=segment)


def shift_from_given_s(frames: Frames, drift: Drift, camera: Floats, deviation: Floats) -> Floats:
    """What the clock's rate and drift add to video time (F,): s tau + deviation(tau)."""
    shift = frames.video_s * camera[frames.camera, SCALE]
    if drift.count:
        drifting = drift.segment >= 0
        left = drift.segment[drifting]
        width = drift.knot_s[left + 1] - drift.knot_s[left]
        share = (frames.video_s[drifting] - drift.knot_s[left]) / width
        shift[drifting] += deviation[left] * (1 - share) + deviation[left + 1] * share
    return np.asarray(shift)


def common_time_s(frames: Frames, drift: Drift, camera: Floats, deviation: Floats) -> Floats:
    """Common time (F,) of every frame, with the cameras' parameters (C, 11) and the knots' deviations (D,)."""
    time = frames.video_s + camera[frames.camera, OFFSET]
    return np.asarray(time + shift_from_given_s(frames, drift, camera, deviation))
