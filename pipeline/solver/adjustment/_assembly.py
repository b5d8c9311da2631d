"""Compiled twin of `assembly.assemble_plain`."""

# As in `_lanes`: spelt out, because that is what makes it fast.
from __future__ import annotations

import numpy as np

from calibration.foundation.arrays import Floats, Floats2, Floats3, Floats4, Ints1, Ints2
from calibration.foundation.compiled import compiled


@compiled
def assemble(
    normal: Floats3,
    gradient: Floats2,
    transform: Floats4,
    degree: Ints1,
    span: Ints1,
    local_from_camera: Floats3,
    columns: Ints2,
    n_band: int,
    n_border: int,
    width: int,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Twin of `assembly.assemble_plain`: band (w + 1, n), border (n, q), corner (q, q), gradient (n + q,).

    `transform` (S, N, K + 1, K + 1) holds every target's own columns first, `degree` (N,) says how many are its.
    """
    n_blocks, size = gradient.shape
    n_targets, powers = transform.shape[1], transform.shape[2]
    first_q = 3 * n_targets * powers
    wide = columns.shape[1]
    parameters = local_from_camera.shape[2]
    first_p = wide - parameters
    band, border = np.zeros((width + 1, n_band)), np.zeros((n_band, n_border))
    corner, right = np.zeros((n_border, n_border)), np.zeros(n_band + n_border)
    half, vector = np.zeros((wide, size)), np.zeros(wide)
    for b in range(n_blocks):
        N, g, place, q_from_p = normal[b], gradient[b], columns[b], local_from_camera[b]
        half[:] = 0.0
        vector[:] = 0.0
        column = 0
        for n in range(n_targets):
            T = transform[span[b], n]
            for axis in range(3):
                row = (3 * n + axis) * powers
                for a in range(degree[n] + 1):
                    if place[column] >= 0:
                        for k in range(powers):
                            t = T[k, a]
                            if t != 0.0:
                                vector[column] += t * g[row + k]
                                for j in range(size):
                                    half[column, j] += t * N[row + k, j]
                    column += 1
        for p in range(parameters):
            if place[first_p + p] >= 0:
                for q in range(q_from_p.shape[0]):
                    t = q_from_p[q, p]
                    if t != 0.0:
                        vector[first_p + p] += t * g[first_q + q]
                        for j in range(size):
                            half[first_p + p, j] += t * N[first_q + q, j]
        for i in range(wide):
            row_place = place[i]
            if row_place < 0:
                continue
            right[row_place] += vector[i]
            column = 0
            for n in range(n_targets):
                T = transform[span[b], n]
                for axis in range(3):
                    row = (3 * n + axis) * powers
                    for a in range(degree[n] + 1):
                        at = place[column]
                        if at >= 0 and at <= row_place:
                            s = 0.0
                            for k in range(powers):
                                s += half[i, row + k] * T[k, a]
                            if row_place < n_band:
                                band[row_place - at, at] += s
                            elif at < n_band:
                                border[at, row_place - n_band] += s
                            else:
                                corner[row_place - n_band, at - n_band] += s
                        column += 1
            for p in range(parameters):
                at = place[first_p + p]
                if at >= 0 and at <= row_place:
                    s = 0.0
                    for q in range(q_from_p.shape[0]):
                        s += half[i, first_q + q] * q_from_p[q, p]
                    corner[row_place - n_band, at - n_band] += s
    for i in range(n_border):
        for j in range(i):
            corner[j, i] = corner[i, j]
    return band, border, corner, right
