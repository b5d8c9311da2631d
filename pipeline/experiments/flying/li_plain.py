"""Li's iteration written down with NumPy and SciPy alone, as one would without this project's compiled elimination.

A round is the trajectory intersection (paper eq. 8), one dense least squares for each target's coefficients, and, at
the motion found, MINPACK's Levenberg-Marquardt in every camera's offset with the exact derivative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import leastsq

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.methods.li import STILL_S
from pipeline.solver.observation.observations import Frames


@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """One target's m sightings: `across` (m, 3, 3) is V = I - L L' (paper eq. 6), `at` (m, 3) V C."""

    camera: Ints
    video_s: Floats
    across: Floats
    at: Floats
    order: int

    def of(self, camera: int) -> Sights:
        """Those of one camera."""
        own = self.camera == camera
        return Sights(
            camera=self.camera[own], video_s=self.video_s[own], across=self.across[own], at=self.at[own],
            order=self.order,
        )  # fmt: skip


def sights_of(frames: Frames, orders: list[int]) -> list[Sights]:
    """The sightings of every target."""
    found = []
    for n, order in enumerate(orders):
        seen = frames.seen[:, n]
        ray = np.einsum("fji,fj->fi", frames.cam_from_enu[seen], frames.ray[seen, n])
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
        at = np.einsum("fij,fj->fi", across, frames.position_m[seen])
        found.append(
            Sights(camera=frames.camera[seen], video_s=frames.video_s[seen], across=across, at=at, order=order)
        )
    return found


def iterated(targets: list[Sights], offset_s: Floats, max_rounds: int) -> tuple[Floats, int, bool]:
    """Offsets (C,) from the first guesses `offset_s` on (camera 0's stays), rounds, and whether they came to rest."""
    offset, round_ = np.array(offset_s, float), 0
    own = [[t.of(c) for t in targets] for c in range(len(offset))]
    for round_ in range(1, max_rounds + 1):
        motions = [intersected(t, offset) for t in targets]
        before = offset.copy()
        for c in range(1, len(offset)):
            missed = partial(_missed, sights=own[c], motions=motions)
            offset[c] = leastsq(missed, offset[c], Dfun=partial(_slope, sights=own[c], motions=motions))[0][0]
        if np.abs(offset - before).max() < STILL_S:
            return offset, round_, True
    return offset, round_, False


def intersected(sights: Sights, offset_s: Floats) -> Floats:
    """The motion's coefficients (K + 1, 3), of powers of common time, at known offsets (paper eq. 8)."""
    powers = np.vander(sights.video_s + offset_s[sights.camera], sights.order + 1, increasing=True)
    design = (powers[:, None, :, None] * sights.across[:, :, None, :]).reshape(3 * len(powers), -1)
    return np.asarray(np.linalg.lstsq(design, sights.at.ravel(), rcond=None)[0].reshape(-1, 3))


def _missed(offset_s: Floats, sights: list[Sights], motions: list[Floats]) -> Floats:
    """Residuals V (X(t) - C) of one camera, metres (paper eq. 5)."""
    rows = []
    for one, motion in zip(sights, motions, strict=True):
        place = np.vander(one.video_s + offset_s, len(motion), increasing=True) @ motion
        rows.append(np.einsum("fij,fj->fi", one.across, place) - one.at)
    return np.concatenate(rows).ravel()


def _slope(offset_s: Floats, sights: list[Sights], motions: list[Floats]) -> Floats:
    """Their derivative (3 m, 1) with respect to the offset."""
    rows = []
    for one, motion in zip(sights, motions, strict=True):
        speed = motion[1:] * np.arange(1, len(motion))[:, None]
        velocity = np.vander(one.video_s + offset_s, len(speed), increasing=True) @ speed
        rows.append(np.einsum("fij,fj->fi", one.across, velocity))
    return np.concatenate(rows).reshape(-1, 1)
