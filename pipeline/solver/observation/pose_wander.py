"""Errors of measured poses that wander: what an instrument is off by now, it is off by about as much a second later.

A Gauss-Markov process of each camera's six pose errors, with sigma s and correlation time T of its own, on knots of
video time, linear in between:

    x(k + 1) = a x(k) + w,   a = exp(-h / T),   var x = s^2,   var w = s^2 (1 - a^2),   h the knots' spacing

Inside a piece, a third of h, it is taken as constant, so that a block of frames sees a constant pose error as it
always did. What the process does between knots, s^2 h / (3 T) on average, is left to the frames' own errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.solver.observation.observations import Frames

PER_TAU, PIECES = 6.0, 3
"""Knots in a correlation time, and pieces between two knots. More follow the process closer and cost their cube."""
MOST_KNOTS = 31
"""Knots of one camera. Where a flight is longer than they reach, clusters of frames tell its uncertainty."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseWander:
    """Knots of all cameras whose poses wander, one camera's after another.

    first   (C + 1,) where each camera's knots begin; a camera without has none
    knot_s  (K,) video time
    left    (F,) the knot before each frame's piece, -1 where its camera has none; share (F,) of the way to the next
    piece   (F,) number of the piece
    sigma   (C, 6), tau_s (C, 6)
    """

    first: Ints
    knot_s: Floats
    left: Ints
    share: Floats
    piece: Ints
    sigma: Floats
    tau_s: Floats

    @property
    def count(self) -> int:
        """Knots in all."""
        return len(self.knot_s)

    def of(self, camera: int) -> slice:
        """The knots of one camera."""
        return slice(int(self.first[camera]), int(self.first[camera + 1]))

    def at(self, value: Floats, rows: Ints | slice) -> Floats:
        """(n, 6) errors of the frames `rows` from those of the knots (K, 6)."""
        left, share = self.left[rows], self.share[rows][:, None]
        if not self.count:
            return np.zeros((len(left), 6))
        inside = (left >= 0)[:, None]
        return np.where(inside, (1 - share) * value[left] + share * value[np.minimum(left + 1, self.count - 1)], 0.0)

    @cached_property
    def penalties(self) -> tuple[tuple[int, int, Floats], ...]:
        """Camera, axis, and the precision (k, k) at the camera's knots, of every error that wanders."""
        return tuple(
            (c, int(axis), wander_penalty(self, c, int(axis)))
            for c in range(len(self.first) - 1)
            if self.first[c + 1] > self.first[c]
            for axis in np.flatnonzero(self.sigma[c] > 0)
        )


def without_wander(frames: Frames) -> PoseWander:
    """Poses whose errors are constant, or new in every frame."""
    cameras = len(frames.cameras)
    return PoseWander(
        first=np.zeros(cameras + 1, dtype=np.int64), knot_s=np.empty(0),
        left=np.full(frames.count, -1, dtype=np.int64), share=np.zeros(frames.count),
        piece=np.zeros(frames.count, dtype=np.int64), sigma=np.zeros((cameras, 6)), tau_s=np.ones((cameras, 6)),
    )  # fmt: skip


def wander_knots(frames: Frames, sigma: Floats, tau_s: Floats) -> PoseWander:
    """Knots for the cameras that have a sigma (C, 6) above zero, as dense as their shortest time (C, 6) asks for."""
    base = without_wander(frames)
    left, share, piece = base.left.copy(), base.share.copy(), base.piece.copy()
    first, knots = [0], []
    for c in range(len(frames.cameras)):
        part, own = frames.of(c), np.empty(0)
        if (sigma[c] > 0).any():
            video = frames.video_s[part]
            own = _knots(video, float(tau_s[c][sigma[c] > 0].min()))
            step = (own[1] - own[0]) / PIECES
            number = np.clip(np.floor((video - own[0]) / step), 0, PIECES * (len(own) - 1) - 1).astype(np.int64)
            left[part], share[part] = first[-1] + number // PIECES, (number % PIECES + 0.5) / PIECES
            piece[part] = number
        knots.append(own)
        first.append(first[-1] + len(own))
    return PoseWander(
        first=np.array(first, dtype=np.int64), knot_s=np.concatenate(knots), left=left, share=share, piece=piece,
        sigma=sigma, tau_s=tau_s,
    )  # fmt: skip


def _knots(video_s: Floats, tau_s: float) -> Floats:
    length = max(float(np.ptp(video_s)), 1e-6)
    pieces = int(np.clip(np.ceil(length * PER_TAU / tau_s), 2, MOST_KNOTS - 1))
    return np.linspace(video_s.min(), video_s.max(), pieces + 1)


def wander_penalty(wander: PoseWander, camera: int, axis: int) -> Floats:
    """(k, k) precision of one error of one camera at its knots."""
    knots = wander.knot_s[wander.of(camera)]
    sigma, tau = float(wander.sigma[camera, axis]), float(wander.tau_s[camera, axis])
    stays = np.exp(-np.diff(knots) / tau)
    rows = np.eye(len(knots))
    rows[np.arange(1, len(knots)), np.arange(len(knots) - 1)] = -stays
    rows[1:] /= np.sqrt(1 - stays**2)[:, None]
    return np.asarray(rows.T @ rows / sigma**2)


def between_knots(wander: PoseWander, camera: int) -> Floats:
    """(6,) sigma of what each error does between two knots."""
    knots = wander.knot_s[wander.of(camera)]
    if not len(knots):
        return np.zeros(6)
    share = (knots[1] - knots[0]) / (3 * wander.tau_s[camera])
    return np.asarray(wander.sigma[camera] * np.sqrt(np.minimum(share, 1.0)))
