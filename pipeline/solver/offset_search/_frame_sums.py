"""Compiled twin of `polynomial_polish.frame_sums_plain`."""

# The arithmetic is spelt out in scalars: that is what makes it fast.
from __future__ import annotations

import math

import numpy as np

from calibration.foundation.arrays import Floats, Floats1, Floats2, Floats3, Floats4
from calibration.foundation.compiled import compiled


@compiled
def _powers(u: float, out: Floats) -> None:
    """1, u, u^2, ... into `out`."""
    out[0] = 1.0
    for k in range(1, len(out)):
        out[k] = out[k - 1] * u


@compiled
def _rows(
    present: float, away: Floats, speed: Floats, lag: float, axes: Floats, turn: Floats, ray: Floats, across: Floats,
    by_tilt: Floats, work: Floats, out: Floats,
) -> None:  # fmt: skip
    """Both residuals of one sighting and their derivatives (2, 12): by clock (2), tilt (3), shift (3), position (3).

    away, speed (3,) of the target from the camera in ENU; axes (3, 3) enu_from_cam; turn (3, 3) the camera's constant
    rotation; ray (3,), across and by_tilt (2, 3) in axes of the camera; work (2, 3).
    """
    leaned, turned = work[0], work[1]
    for j in range(3):
        leaned[j] = away[0] * axes[0, j] + away[1] * axes[1, j] + away[2] * axes[2, j]
    for j in range(3):
        turned[j] = leaned[0] * turn[0, j] + leaned[1] * turn[1, j] + leaned[2] * turn[2, j]
    depth = max(turned[0] * ray[0] + turned[1] * ray[1] + turned[2] * ray[2], 1.0)
    for a in range(2):
        error = (across[a, 0] * turned[0] + across[a, 1] * turned[1] + across[a, 2] * turned[2]) / depth
        for j in range(3):
            leaned[j] = (across[a, j] - error * ray[j]) * present / depth
        out[a, 0] = error * present
        for j in range(3):
            out[a, 3 + j] = present * (
                by_tilt[a, 0] * turn[j, 0] + by_tilt[a, 1] * turn[j, 1] + by_tilt[a, 2] * turn[j, 2]
            )
        x = leaned[0] * turn[0, 0] + leaned[1] * turn[0, 1] + leaned[2] * turn[0, 2]
        y = leaned[0] * turn[1, 0] + leaned[1] * turn[1, 1] + leaned[2] * turn[1, 2]
        z = leaned[0] * turn[2, 0] + leaned[1] * turn[2, 1] + leaned[2] * turn[2, 2]
        by_time = 0.0
        for i in range(3):
            slope = axes[i, 0] * x + axes[i, 1] * y + axes[i, 2] * z
            out[a, 6 + i] = -slope
            out[a, 9 + i] = slope
            by_time += slope * speed[i]
        out[a, 1] = by_time
        out[a, 2] = by_time * lag


@compiled
def frame_sums(
    time_s: Floats1, present: Floats2, centre_m: Floats2, axes: Floats3, ray: Floats3, across: Floats4,
    by_tilt: Floats4, inverse: Floats3, clock: Floats1, middle_s: float, turn: Floats2, shift: Floats1,
    motion: Floats3, epoch_s: float, scale_s: float,
) -> tuple[Floats, float]:  # fmt: skip
    """Twin of `polynomial_polish.frame_sums_plain`; motion (K + 1, n, 3) in powers of (t - epoch) / scale."""
    n, terms = present.shape[1], motion.shape[0]
    columns, rows = 9 + 3 * n, 2 * n
    powers = np.zeros(2 * terms - 1)
    sums = np.zeros((2 * terms - 1, columns, columns))
    white, product = np.zeros((rows, columns)), np.zeros((columns, columns))
    sighting = np.zeros((n, 2, 12))
    away, speed, work = np.zeros(3), np.zeros(3), np.zeros((2, 3))
    cost = 0.0
    for f in range(len(time_s)):
        _powers((clock[1] * time_s[f] + clock[0] - epoch_s) / scale_s, powers)
        lag, many = time_s[f] - middle_s, 0.0
        for k in range(n):
            for i in range(3):
                place, rate = motion[0, k, i], 0.0
                for p in range(1, terms):
                    place += motion[p, k, i] * powers[p]
                    rate += p * motion[p, k, i] * powers[p - 1]
                away[i] = place - centre_m[f, i] - shift[i]
                speed[i] = rate / scale_s
            _rows(
                present[f, k], away, speed, lag, axes[f], turn, ray[f, k], across[f, k], by_tilt[f, k], work,
                sighting[k],
            )  # fmt: skip
            many += 2.0 * present[f, k]
        square = 0.0
        for r in range(rows):
            one = white[r]
            one[:] = 0.0
            for q in range(r + 1):
                w, k = inverse[f, r, q], q // 2
                seen = sighting[k, q - 2 * k]
                for j in range(9):
                    one[j] += w * seen[j]
                for j in range(3):
                    one[9 + 3 * k + j] += w * seen[9 + j]
            square += one[0] * one[0]
        limit = many + 6.0 * math.sqrt(2.0 * many) + 1e-9
        weight = min(1.0, limit / max(square, 1e-30))
        cost += 0.5 * (square if square <= limit else limit * (1.0 + math.log(square / limit + 1e-30)))
        product[:] = 0.0
        for r in range(rows):
            one, last = white[r], 12 + 3 * (r // 2)
            for i in range(last):
                w, into = weight * one[i], product[i]
                for j in range(i, last):
                    into[j] += w * one[j]
        for p in range(len(powers)):
            u = powers[p]
            for i in range(columns):
                of, into = product[i], sums[p, i]
                for j in range(i, columns):
                    into[j] += u * of[j]
    for p in range(len(powers)):
        for i in range(columns):
            for j in range(i):
                sums[p, i, j] = sums[p, j, i]
    return sums, cost
