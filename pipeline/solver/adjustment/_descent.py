"""Compiled steps of a descent whose unknowns are few and all in the border: polynomials, affine clocks.

A small flight (two cameras, fifty frames) is adjusted in less time than NumPy needs to look at its arrays one by one.
For such models every iteration is five calls: `damped_step`, `tried`, `_kernels.kept_steps`, `_kernels.block_normals`,
`folded`. None of them calls another large one, since a callee would be compiled again inside every caller.
`compiled_descent.py` is the only caller and checks what it hands in.
"""

# As in `_lanes`: spelt out, because that is what makes it fast.
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from calibration.foundation.arrays import (
    Floats,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Ints,
    Ints1,
    Ints2,
)  # fmt: skip
from calibration.foundation.compiled import compiled
from pipeline.solver.adjustment._kernels import Observed
from pipeline.solver.adjustment._lanes import turn

OFFSET, SCALE, START, READOUT, FOCAL, PARAMETERS = 7, 8, 9, 10, 6, 11


class Course(NamedTuple):
    """What a point does not change, of a model with one span.

    video_s, frame_camera (F,); begin (B + 1,), block_camera (B,): the blocks' frames and cameras
    share (F,), share_per_s (C,): of drifting place errors; place_gain (F, N), without frames where there are none
    first, degree (N,): the targets' first coefficients and degrees
    mid_s, half_s: the span
    coefficient (P, 3), camera (C, W), motion (3 N (K + 1),): columns of the unknowns, -1 where held; `motion` is by
    target, axis and power, as the local unknowns are
    """

    video_s: Floats1
    frame_camera: Ints1
    begin: Ints1
    block_camera: Ints1
    share: Floats1
    share_per_s: Floats1
    place_gain: Floats2
    first: Ints1
    degree: Ints1
    mid_s: float
    half_s: float
    coefficient: Ints2
    camera: Ints2
    motion: Ints1


class Local(NamedTuple):
    """A point as the blocks see it: u (F,), chain (B, 12 [+ 4 N], W), series (B, N, 3, K + 1), shift (F or 0, N, 2)."""

    u: Floats1
    chain: Floats3
    series: Floats4
    shift: Floats3


@compiled
def motion_columns(coefficient: Ints2, first: Ints1, degree: Ints1, powers: int) -> Ints:
    """The column of every local unknown of the motion: one span, so that powers are coefficients; -1: none."""
    out = np.full(3 * len(first) * powers, -1)
    for n in range(len(first)):
        for axis in range(3):
            for k in range(degree[n] + 1):
                out[(3 * n + axis) * powers + k] = coefficient[first[n] + k, axis]
    return out


@compiled
def localise(course: Course, coefficients: Floats2, camera: Floats2, out: Local) -> None:
    """Fills `out` at coefficients (P, 3) and cameras (C, W): the chain rule, the power series, the place errors."""
    u, chain, series, shift = out
    first, degree, half_s = course.first, course.degree, course.half_s
    for f in range(len(u)):
        c = course.frame_camera[f]
        u[f] = (course.video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - course.mid_s) / half_s
    chain[:] = 0.0
    for b in range(len(course.block_camera)):
        c, f = course.block_camera[b], course.begin[b]
        slope = half_s / (1.0 + camera[c, SCALE])
        middle = course.video_s[f] - u[f] * slope
        for i in range(FOCAL + 1):
            chain[b, i, i] = 1.0
        chain[b, 7, OFFSET] = chain[b, 9, START] = chain[b, 11, READOUT] = 1.0
        chain[b, 7, SCALE] = chain[b, 9, SCALE] = middle
        chain[b, 8, SCALE] = chain[b, 10, SCALE] = slope
        share_slope = slope * course.share_per_s[c]
        for i in range(PARAMETERS, chain.shape[1] - 1, 2):
            chain[b, i + 1, i] = 1.0
            chain[b, i + 1, i + 1] = course.share[f] - u[f] * share_slope
            chain[b, i + 2, i + 1] = share_slope
    series[:] = 0.0
    for n in range(len(first)):
        for axis in range(series.shape[2]):
            for k in range(degree[n] + 1):
                for b in range(len(series)):
                    series[b, n, axis, k] = coefficients[first[n] + k, axis]
    for f in range(len(shift)):
        c = course.frame_camera[f]
        for n in range(shift.shape[1]):
            for axis in range(2):
                p = PARAMETERS + 4 * n + 2 * axis
                shift[f, n, axis] = course.place_gain[f, n] * (camera[c, p] + course.share[f] * camera[c, p + 1])


@compiled
def folded(
    course: Course,
    normal: Floats3,
    gradient: Floats2,
    chain: Floats3,
    camera: Floats2,
    mean: Floats2,
    precision: Floats2,
    size: int,
) -> tuple[Floats, Floats, float]:
    """Twin of `assembly.assemble` without a band, with cameras' priors: lower half of the corner, gradient, their cost.

    normal (B, L, L), gradient (B, L) of the blocks; camera, mean, precision (C, W); corner (q, q), gradient (q,)
    """
    corner, right, cost = np.zeros((size, size)), np.zeros(size), 0.0
    motion, many = course.motion, chain.shape[1]
    moved = len(motion)
    column = np.zeros(normal.shape[2])
    for b in range(len(course.block_camera)):
        N, g, L = normal[b], gradient[b], chain[b]
        for i in range(moved):
            row = motion[i]
            if row >= 0:
                right[row] += g[i]
                for j in range(i + 1):
                    if motion[j] >= 0:
                        corner[row, motion[j]] += N[i, j]
        for p in range(L.shape[1]):
            row = course.camera[course.block_camera[b], p]
            if row < 0:
                continue
            column[:] = 0.0
            for q in range(many):
                t = L[q, p]
                if t != 0.0:
                    right[row] += t * g[moved + q]
                    for j in range(len(column)):
                        column[j] += t * N[moved + q, j]
            for j in range(moved):
                if motion[j] >= 0:
                    corner[row, motion[j]] += column[j]
            for other in range(p + 1):
                at = course.camera[course.block_camera[b], other]
                if at >= 0:
                    s = 0.0
                    for q in range(many):
                        s += column[moved + q] * L[q, other]
                    corner[row, at] += s
    for c in range(camera.shape[0]):
        for p in range(camera.shape[1]):
            off = camera[c, p] - mean[c, p]
            cost += 0.5 * precision[c, p] * off * off
            at = course.camera[c, p]
            if at >= 0:
                corner[at, at] += precision[c, p]
                right[at] += precision[c, p] * off
    return corner, right, cost


@compiled
def _factor(corner: Floats, amount: Floats, upper: Floats) -> float:
    """U with U'U = corner + diag(amount) into `upper`, its diagonal inverted; the smallest squared pivot, or zero.

    Reads the lower half of `corner`.
    """
    n, smallest = len(corner), np.inf
    for i in range(n):
        for j in range(i + 1):
            upper[j, i] = corner[i, j]
        upper[i, i] += amount[i]
    for first in range(0, n, 2):  # two rows at once: half the traffic with memory
        for k in range(first, min(first + 2, n)):
            if k > first:
                s = upper[first, k]
                for j in range(k, n):
                    upper[k, j] -= s * upper[first, j]
            if not upper[k, k] > 0.0:
                return 0.0
            smallest = min(smallest, upper[k, k])
            inverse = 1.0 / math.sqrt(upper[k, k])
            upper[k, k] = inverse
            for j in range(k + 1, n):
                upper[k, j] *= inverse
        for i in range(first + 2, n):
            s, t = upper[first, i], upper[first + 1, i]
            for j in range(i, n):
                upper[i, j] -= s * upper[first, j] + t * upper[first + 1, j]
    return smallest


@compiled
def _solved(upper: Floats, right: Floats, out: Floats) -> None:
    """out = - (U'U)^-1 right; the diagonal of `upper` holds its inverse."""
    n = len(right)
    for i in range(n):
        out[i] = -right[i]
    for k in range(n):
        out[k] *= upper[k, k]
        for j in range(k + 1, n):
            out[j] -= upper[k, j] * out[k]
    for k in range(n - 1, -1, -1):
        s = out[k]
        for j in range(k + 1, n):
            s -= upper[k, j] * out[j]
        out[k] = s * upper[k, k]


@compiled
def damped_step(corner: Floats2, right: Floats1, damping: float) -> tuple[float, float, Floats]:
    """Smallest squared pivot (0: not positive), what the step takes off the quadratic model, and the step (q,).

    Reads the lower half of `corner`; the damping is relative to its diagonal.
    """
    size, greatest, foretold = len(right), 0.0, 0.0
    amount, step, upper = np.zeros(size), np.zeros(size), np.zeros((size, size))
    for i in range(size):
        greatest = max(greatest, corner[i, i])
    for i in range(size):
        amount[i] = damping * max(corner[i, i], 1e-12 * max(1e-300, greatest))
    pivot = _factor(corner, amount, upper)
    if pivot > 0.0:
        _solved(upper, right, step)
        for i in range(size):
            foretold += 0.5 * step[i] * (amount[i] * step[i] - right[i])
    return pivot, foretold, step


@compiled
def tried(
    course: Course, chain: Floats3, step: Floats1, coefficients: Floats2, camera: Floats2
) -> tuple[Floats, Floats, Floats]:
    """Coefficients (P, 3) and cameras (C, W) a step away, and the step (B, L) of the local unknowns."""
    coefficients_there, camera_there = coefficients.copy(), camera.copy()
    for i in range(len(coefficients)):
        for axis in range(coefficients.shape[1]):
            at = course.coefficient[i, axis]
            if at >= 0:
                coefficients_there[i, axis] += step[at]
    for c in range(camera.shape[0]):
        for p in range(camera.shape[1]):
            at = course.camera[c, p]
            if at >= 0:
                camera_there[c, p] += step[at]
    moved = len(course.motion)
    local = np.zeros((len(chain), moved + chain.shape[1]))
    for b in range(len(chain)):
        for i in range(moved):
            at = course.motion[i]
            if at >= 0:
                local[b, i] = step[at]
        for q in range(chain.shape[1]):
            s = 0.0
            for p in range(chain.shape[2]):
                at = course.camera[course.block_camera[b], p]
                if at >= 0:
                    s += chain[b, q, p] * step[at]
            local[b, moved + q] = s
    return coefficients_there, camera_there, local


@compiled
def _squares(rows: Floats, out: Floats) -> None:
    """Sums over `rows` (n, 3) into `out` (6,): xx, yy, zz, xy, xz, yz."""
    out[:] = 0.0
    for r in range(len(rows)):
        x, y, z = rows[r, 0], rows[r, 1], rows[r, 2]
        out[0] += x * x
        out[1] += y * y
        out[2] += z * z
        out[3] += x * y
        out[4] += x * z
        out[5] += y * z


@compiled
def motion_alone(observed: Observed, course: Course, camera: Floats2, rank: float, coefficients: Floats2) -> float:
    """Twin of `intersection._motion_step`, where every target has its own equations: `coefficients` (P, 3) and a pivot.

    A sighting's share is the square of V (X - C): V'V is I - d d', d the ray in axes of the map, or what the gains say.
    Pivot: the smallest, relative to the diagonal; -1 where a coefficient is touched by nothing, 0 where singular.
    """
    cam_from_enu, position, ray, gain = observed.cam_from_enu, observed.position_m, observed.ray, observed.gain
    video_s, frame_camera, first, degree = course.video_s, course.frame_camera, course.first, course.degree
    mid_s, half_s, axes = course.mid_s, course.half_s, position.shape[1]
    targets, powers = len(first), degree.max() + 1
    moment, vector = np.zeros((targets, 2 * powers - 1, 6)), np.zeros((targets, powers, 3))
    error, turned, whole = np.zeros(6), np.zeros((3, 3)), np.zeros(6)
    square, place, pulled, lines = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros((2, 3))
    for f in range(len(video_s)):
        c = frame_camera[f]
        u = (video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - mid_s) / half_s
        for i in range(2 * axes):
            error[i] = camera[c, i]
        for i in range(axes):
            place[i] = position[f, i] + error[3 + i]
        turn(error, cam_from_enu[f], turned)
        magnified = math.exp(camera[c, FOCAL])
        for i in range(axes):
            turned[0, i] *= magnified
            turned[1, i] *= magnified
        _squares(turned, whole)
        for n in range(targets):
            if not observed.seen[f, n]:
                continue
            if observed.angular:
                for i in range(axes):
                    lines[0, i] = (
                        ray[f, n, 0] * turned[0, i] + ray[f, n, 1] * turned[1, i] + ray[f, n, 2] * turned[2, i]
                    )
                _squares(lines[:1], square)
                for i in range(2 * axes):
                    square[i] = whole[i] - square[i]
            else:
                for row in range(2):
                    g = gain[f, n, row]
                    for i in range(axes):
                        lines[row, i] = g[0] * turned[0, i] + g[1] * turned[1, i] + g[2] * turned[2, i]
                _squares(lines, square)
            pulled[0] = square[0] * place[0] + square[3] * place[1] + square[4] * place[2]
            pulled[1] = square[3] * place[0] + square[1] * place[1] + square[5] * place[2]
            pulled[2] = square[4] * place[0] + square[5] * place[1] + square[2] * place[2]
            power = 1.0
            for k in range(2 * degree[n] + 1):
                for i in range(2 * axes):
                    moment[n, k, i] += power * square[i]
                if k <= degree[n]:
                    for i in range(axes):
                        vector[n, k, i] += power * pulled[i]
                power *= u
    smallest: float = np.inf
    for n in range(targets):
        smallest = min(smallest, _own_motion(moment[n], vector[n], degree[n] + 1, rank, coefficients[first[n] :]))
        if not smallest > 0.0:
            return smallest
    return smallest


@compiled
def _own_motion(moment: Floats, vector: Floats, powers: int, rank: float, out: Floats) -> float:
    """Coefficients `out` (powers, 3) of one target from its moments (2 powers - 1, 6); the smallest pivot."""
    size = 3 * powers
    corner, upper, scale = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    right, step = np.zeros(size), np.zeros(size)
    for k in range(powers):
        for i in range(3):
            if not moment[2 * k, i] > 0.0:
                return -1.0
            scale[3 * k + i] = 1.0 / math.sqrt(moment[2 * k, i])
            right[3 * k + i] = -scale[3 * k + i] * vector[k, i]
    for k in range(powers):
        for l in range(powers):  # noqa: E741
            m = moment[k + l]
            for i in range(3):
                for j in range(3):
                    value = m[i] if i == j else m[i + j + 2]
                    corner[3 * k + i, 3 * l + j] = value * scale[3 * k + i] * scale[3 * l + j]
    pivot: float = _factor(corner, np.full(size, rank), upper)
    if pivot > 0.0:
        _solved(upper, right, step)
        for k in range(powers):
            for i in range(3):
                out[k, i] = scale[3 * k + i] * step[3 * k + i]
    return pivot
