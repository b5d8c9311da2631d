"""Compiled twin of the whole descent where the unknowns are few: polynomials, affine clocks, poses held in log time.

A small flight (two cameras, fifty frames) is adjusted in less time than Python needs to look at its arrays, so for such
models one call does all of `levenberg.levenberg_marquardt`: linearise, damp, step, compare. The elimination itself is
`_kernels.block_normals`; the plain loop stays the reference, and tests hold the two to the same path.

`no` is False, handed in so that it is no literal: the elimination is compiled for one set of types only.

Bare arrays in, bare arrays out; `compiled_descent.py` is the only caller and checks them.
"""

# As in `_kernels`: spelt out, because that is what makes it fast.
from __future__ import annotations

import math

import numpy as np

from calibration.foundation.compiled import compiled, inlined
from pipeline.solver.adjustment._kernels import _sight, _stretch, _turn, block_normals, kept_steps

CONVERGED, LIMIT, STALLED = 0, 1, 2
FIRST_DAMPING, NEARLY_FULL = 1e-7, 1e-4
"""Relative. Every iteration keeps a share of the error that grows with damping and condition (1e-4 costs some two more
iterations); a step damped by no more than `NEARLY_FULL` is as good as the full one when it says that nothing is to
gain."""
OFFSET, SCALE, START, FOCAL, PARAMETERS = 7, 8, 9, 6, 10


@compiled
def _motion_places(order_coefficient, first, degree, powers):  # type: ignore[no-untyped-def]
    """The global place of every local unknown of the motion: one span, so that powers are coefficients; -1: none."""
    out = np.full(3 * len(first) * powers, -1)
    for n in range(len(first)):
        for axis in range(3):
            for k in range(degree[n] + 1):
                out[(3 * n + axis) * powers + k] = order_coefficient[first[n] + k, axis]
    return out


@compiled
def _where(  # type: ignore[no-untyped-def]
    video_s, frame_camera, camera, begin, block_camera, mid_s, half_s, share, share_per_s, u, local
):
    """Times u (F,) inside the span, and the chain rule `local` (B, 11 [+ 4 N], W), at the clocks of `camera` (C, W)."""
    for f in range(len(video_s)):
        c = frame_camera[f]
        u[f] = (video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - mid_s) / half_s
    local[:] = 0.0
    for b in range(len(block_camera)):
        c, f = block_camera[b], begin[b]
        slope = half_s / (1.0 + camera[c, SCALE])
        middle = video_s[f] - u[f] * slope
        for i in range(FOCAL + 1):
            local[b, i, i] = 1.0
        local[b, 7, OFFSET] = local[b, 9, START] = 1.0
        local[b, 7, SCALE] = local[b, 9, SCALE] = middle
        local[b, 8, SCALE] = local[b, 10, SCALE] = slope
        share_slope = slope * share_per_s[c]
        for i in range(PARAMETERS, local.shape[1] - 1, 2):
            local[b, i + 1, i] = 1.0
            local[b, i + 1, i + 1] = share[f] - u[f] * share_slope
            local[b, i + 2, i + 1] = share_slope


@compiled
def _shifts(camera, frame_camera, place_gain, share, shift):  # type: ignore[no-untyped-def]
    """Twin of `residuals.place_shift` into `shift` (F, N, 2), which has no frames where there are no place errors."""
    for f in range(len(shift)):
        c = frame_camera[f]
        for n in range(shift.shape[1]):
            for axis in range(2):
                p = PARAMETERS + 4 * n + 2 * axis
                shift[f, n, axis] = place_gain[f, n] * (camera[c, p] + share[f] * camera[c, p + 1])


@compiled
def _series(coefficients, first, degree, out):  # type: ignore[no-untyped-def]
    """Power series `out` (B, N, 3, K + 1) of all targets, the same in every block."""
    out[:] = 0.0
    for n in range(len(first)):
        for axis in range(3):
            for k in range(degree[n] + 1):
                for b in range(len(out)):
                    out[b, n, axis, k] = coefficients[first[n] + k, axis]


@compiled
def _fold(normal, gradient, motion, local, block_camera, order_camera, size):  # type: ignore[no-untyped-def]
    """Twin of `assembly.assemble` without a band: the lower half of the corner (q, q), and the gradient (q,)."""
    corner, right = np.zeros((size, size)), np.zeros(size)
    moved, many = len(motion), local.shape[1]
    column = np.zeros(normal.shape[2])
    for b in range(len(block_camera)):
        N, g, L = normal[b], gradient[b], local[b]
        for i in range(moved):
            row = motion[i]
            if row >= 0:
                right[row] += g[i]
                for j in range(i + 1):
                    if motion[j] >= 0:
                        corner[row, motion[j]] += N[i, j]
        for p in range(local.shape[2]):
            row = order_camera[block_camera[b], p]
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
                at = order_camera[block_camera[b], other]
                if at >= 0:
                    s = 0.0
                    for q in range(many):
                        s += column[moved + q] * L[q, other]
                    corner[row, at] += s
    return corner, right


@compiled
def _factor(corner, amount, upper):  # type: ignore[no-untyped-def]
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
def _solved(upper, right, out):  # type: ignore[no-untyped-def]
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


@inlined
def _with_priors(camera, mean, precision, order_camera, corner, right):  # type: ignore[no-untyped-def]
    """Adds the cameras' priors in place and returns their cost."""
    cost = 0.0
    for c in range(camera.shape[0]):
        for p in range(camera.shape[1]):
            off = camera[c, p] - mean[c, p]
            cost += 0.5 * precision[c, p] * off * off
            at = order_camera[c, p]
            if at >= 0:
                corner[at, at] += precision[c, p]
                right[at] += precision[c, p] * off
    return cost


@inlined
def _squares(rows, out):  # type: ignore[no-untyped-def]
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
def motion_alone(  # type: ignore[no-untyped-def]
    cam_from_enu, position, ray, gain, seen, angular, video_s, frame_camera, mid_s, half_s, first, degree, camera, rank,
    coefficients,
):  # fmt: skip
    """Twin of `intersection._motion_step`, where every target has its own equations: `coefficients` (P, 3) and a pivot.

    A sighting's share is the square of V (X - C): V'V is I - d d', d the ray in axes of the map, or what the gains say.
    Pivot: the smallest, relative to the diagonal; -1 where a coefficient is touched by nothing, 0 where singular.
    """
    targets, powers = len(first), degree.max() + 1
    moment, vector = np.zeros((targets, 2 * powers - 1, 6)), np.zeros((targets, powers, 3))
    error, turned, left, whole = np.zeros(6), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(6)
    square, place, pulled, lines = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros((2, 3))
    for f in range(len(video_s)):
        c = frame_camera[f]
        u = (video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - mid_s) / half_s
        for i in range(6):
            error[i] = camera[c, i]
        for i in range(3):
            place[i] = position[f, i] + error[3 + i]
        if error[0] == 0.0 and error[1] == 0.0 and error[2] == 0.0:
            turned[:] = cam_from_enu[f]
        else:
            _turn(error, cam_from_enu[f], turned, left)
        stretch = math.exp(camera[c, FOCAL])
        for i in range(3):
            turned[0, i] *= stretch
            turned[1, i] *= stretch
        _squares(turned, whole)
        for n in range(targets):
            if not seen[f, n]:
                continue
            if angular:
                for i in range(3):
                    lines[0, i] = (
                        ray[f, n, 0] * turned[0, i] + ray[f, n, 1] * turned[1, i] + ray[f, n, 2] * turned[2, i]
                    )
                _squares(lines[:1], square)
                for i in range(6):
                    square[i] = whole[i] - square[i]
            else:
                for row in range(2):
                    g = gain[f, n, row]
                    for i in range(3):
                        lines[row, i] = g[0] * turned[0, i] + g[1] * turned[1, i] + g[2] * turned[2, i]
                _squares(lines, square)
            pulled[0] = square[0] * place[0] + square[3] * place[1] + square[4] * place[2]
            pulled[1] = square[3] * place[0] + square[1] * place[1] + square[5] * place[2]
            pulled[2] = square[4] * place[0] + square[5] * place[1] + square[2] * place[2]
            power = 1.0
            for k in range(2 * degree[n] + 1):
                for i in range(6):
                    moment[n, k, i] += power * square[i]
                if k <= degree[n]:
                    for i in range(3):
                        vector[n, k, i] += power * pulled[i]
                power *= u
    smallest = np.inf
    for n in range(targets):
        smallest = min(smallest, _own_motion(moment[n], vector[n], degree[n] + 1, rank, coefficients[first[n] :]))
        if not smallest > 0.0:
            return smallest
    return smallest


@compiled
def _own_motion(moment, vector, powers, rank, out):  # type: ignore[no-untyped-def]
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
    pivot = _factor(corner, np.full(size, rank), upper)
    if pivot > 0.0:
        _solved(upper, right, step)
        for k in range(powers):
            for i in range(3):
                out[k, i] = scale[3 * k + i] * step[3 * k + i]
    return pivot


@compiled
def descend(  # type: ignore[no-untyped-def]
    cam_from_enu, position, rate, ray, gain, lens, seen, no, angular, spread, prior, pose_damping, kind, bend, video_s,
    frame_camera, place_gain, share, share_per_s, begin, block_camera, mid_s, half_s, first, degree, powers,
    order_coefficient, order_camera, size, mean, precision, first_camera, first_coefficients, first_own, limit, small,
    first_damping, history, kept,
):  # fmt: skip
    """Twin of `levenberg.levenberg_marquardt`: (status, iterations), the point, and the linear system there.

    place_gain (F, N) has no frames where there are no place errors.
    history (limit,) takes the better cost of every iteration.
    kept: room for what the elimination keeps of every frame; without chunks where no frame has an error of its own.
    """
    frames, blocks, targets = len(video_s), len(block_camera), len(first)
    placed = len(place_gain) > 0
    keep, many = len(kept) > 0, 11 + (4 * targets if placed else 0)
    shift, u = np.zeros((len(place_gain), targets, 2)), np.zeros(frames)
    local = np.zeros((blocks, many, first_camera.shape[1]))
    u_there, local_there = u.copy(), local.copy()
    series = np.zeros((blocks, targets, 3, powers))
    series_there = series.copy()
    half = np.full(blocks, half_s)
    motion = _motion_places(order_coefficient, first, degree, powers)
    camera, coefficients = first_camera.copy(), first_coefficients.copy()
    own, own_there = first_own.copy(), np.empty_like(first_own) if len(kept) > 0 else first_own.copy()
    camera_there, coefficients_there = camera.copy(), coefficients.copy()
    amount, step, upper = np.zeros(size), np.zeros(size), np.zeros((size, size))
    moved = np.zeros((blocks, len(motion) + many))
    damping, growth = first_damping, 2.0

    _where(
        video_s, frame_camera, camera, begin, block_camera, mid_s, half_s, share, share_per_s, u, local
    )  # fmt: skip
    _series(coefficients, first, degree, series)
    _shifts(camera, frame_camera, place_gain, share, shift)
    normal, gradient, cost, frame_gain = block_normals(
        cam_from_enu, position, rate, no, ray, gain, lens, seen, angular, spread, prior, pose_damping, kind, bend,
        series, camera[:, :6].copy(), camera[:, FOCAL].copy(), own, shift, place_gain, begin, block_camera, u, half,
        keep, kept,
    )  # fmt: skip
    corner, right = _fold(normal, gradient, motion, local, block_camera, order_camera, size)
    cost += _with_priors(camera, mean, precision, order_camera, corner, right)
    status, iteration = LIMIT, limit
    for count in range(1, limit + 1):
        greatest = 0.0
        for i in range(size):
            greatest = max(greatest, corner[i, i])
        for i in range(size):
            amount[i] = damping * max(corner[i, i], 1e-12 * max(1e-300, greatest))
        history[count - 1] = cost
        if _factor(corner, amount, upper) > 0.0:
            _solved(upper, right, step)
            foretold = frame_gain
            for i in range(size):
                foretold += 0.5 * step[i] * (amount[i] * step[i] - right[i])
            if foretold <= small * cost and damping <= NEARLY_FULL:
                status, iteration = CONVERGED, count
                break
            # --- the trial point
            for i in range(len(coefficients)):
                for axis in range(3):
                    at = order_coefficient[i, axis]
                    coefficients_there[i, axis] = coefficients[i, axis] + (step[at] if at >= 0 else 0.0)
            for c in range(camera.shape[0]):
                for p in range(camera.shape[1]):
                    at = order_camera[c, p]
                    camera_there[c, p] = camera[c, p] + (step[at] if at >= 0 else 0.0)
            if keep:
                _local_steps(step, motion, local, block_camera, order_camera, moved)
                kept_steps(kept, no, placed, spread, begin, block_camera, u, half, series, moved, own, own_there)
            _where(
                video_s, frame_camera, camera_there, begin, block_camera, mid_s, half_s, share, share_per_s, u_there,
                local_there,
            )  # fmt: skip
            _series(coefficients_there, first, degree, series_there)
            _shifts(camera_there, frame_camera, place_gain, share, shift)
            normal, gradient, cost_there, gain_there = block_normals(
                cam_from_enu, position, rate, no, ray, gain, lens, seen, angular, spread, prior, pose_damping, kind,
                bend, series_there, camera_there[:, :6].copy(), camera_there[:, FOCAL].copy(), own_there, shift,
                place_gain, begin, block_camera, u_there, half, keep, kept,
            )  # fmt: skip
            corner_there, right_there = _fold(normal, gradient, motion, local_there, block_camera, order_camera, size)
            cost_there += _with_priors(camera_there, mean, precision, order_camera, corner_there, right_there)
            ratio = (cost - cost_there) / max(foretold, 1e-300)
            if math.isfinite(cost_there) and ratio > 0.0:
                done = abs(cost - cost_there) <= small * cost
                cost, frame_gain, corner, right = cost_there, gain_there, corner_there, right_there
                own, own_there = own_there, own
                camera, camera_there = camera_there, camera
                coefficients, coefficients_there = coefficients_there, coefficients
                series, series_there = series_there, series
                u, u_there = u_there, u
                local, local_there = local_there, local
                history[count - 1] = cost
                if done:
                    status, iteration = CONVERGED, count
                    break
                damping = max(damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3), 1e-15)
                growth = 2.0
                continue
            if foretold <= small * cost:
                status, iteration = CONVERGED, count
                break
            if keep:  # the trial has taken the room of what was kept here
                _shifts(camera, frame_camera, place_gain, share, shift)
                block_normals(
                    cam_from_enu, position, rate, no, ray, gain, lens, seen, angular, spread, prior, pose_damping, kind,
                    bend, series, camera[:, :6].copy(), camera[:, FOCAL].copy(), own, shift, place_gain, begin,
                    block_camera, u, half, keep, kept,
                )  # fmt: skip
        damping, growth = damping * growth, growth * 2
        if damping > 1e12:
            status, iteration = STALLED, count
            break
    for i in range(size):
        for j in range(i):
            corner[j, i] = corner[i, j]
    return status, iteration, camera, coefficients, own, corner, right, cost, frame_gain


@compiled
def median_length(  # type: ignore[no-untyped-def]
    cam_from_enu, position, ray, gain, lens, seen, angular, spread, video_s, frame_camera, place_gain, share, mid_s,
    half_s, first, degree, powers, camera, coefficients, own,
):  # fmt: skip
    """Median length of the residuals, in sigmas."""
    series = np.zeros((1, len(first), 3, powers))
    _series(coefficients, first, degree, series)
    shift, none = np.zeros((len(place_gain), len(first), 2)), np.zeros(2)
    _shifts(camera, frame_camera, place_gain, share, shift)
    Q, Jx, r = np.zeros((2, 9)), np.zeros((2, 3)), np.zeros(9)
    turned, left, error, place = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(6), np.zeros(3)
    lengths = np.empty(seen.size)
    count = 0
    for f in range(len(video_s)):
        c = frame_camera[f]
        u = (video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - mid_s) / half_s
        for i in range(6):
            error[i] = camera[c, i] + spread[c, i] * own[f, i]
        for i in range(3):
            place[i] = position[f, i] + error[3 + i]
        _turn(error, cam_from_enu[f], turned, left)
        for n in range(len(first)):
            if seen[f, n]:
                stretch, growth = _stretch(lens, f, n, camera[c, FOCAL], math.exp(camera[c, FOCAL]))
                _sight(
                    series[0], n, u, 1.0, turned, left, place, stretch, growth, gain[f, n], ray[f, n],
                    shift[f, n] if len(shift) else none, angular, 0, 1.0, Q, Jx, r,
                )  # fmt: skip
                lengths[count] = math.sqrt(r[0] * r[0] + r[1] * r[1])
                count += 1
    return np.median(lengths[:count])


@compiled
def graduated(  # type: ignore[no-untyped-def]
    cam_from_enu, position, rate, ray, gain, lens, seen, no, angular, spread, prior, pose_damping, kind, bend, video_s,
    frame_camera, place_gain, share, share_per_s, begin, block_camera, mid_s, half_s, first, degree, powers,
    order_coefficient, order_camera, size, mean, precision, camera, coefficients, own, limit, small, first_damping,
    history, stages, short, coarse, far, kept,
):  # fmt: skip
    """Twin of `beginning.graduated_plain`: `descend` with the stages before it; history (stages short + limit,)."""
    done = 0
    for _ in range(stages if kind != 0 else 0):
        late = far * median_length(
            cam_from_enu, position, ray, gain, lens, seen, angular, spread, video_s, frame_camera, place_gain, share,
            mid_s, half_s, first, degree, powers, camera, coefficients, own,
        )  # fmt: skip
        if late <= 1.5 * bend:
            break
        _, count, camera, coefficients, own, _, _, _, _ = descend(
            cam_from_enu, position, rate, ray, gain, lens, seen, no, angular, spread, prior, pose_damping, 1, late,
            video_s, frame_camera, place_gain, share, share_per_s, begin, block_camera, mid_s, half_s, first, degree,
            powers, order_coefficient, order_camera, size, mean, precision, camera, coefficients, own, short, coarse,
            first_damping, history[done:], kept,
        )  # fmt: skip
        done += count
    status, count, camera, coefficients, own, corner, right, cost, frame_gain = descend(
        cam_from_enu, position, rate, ray, gain, lens, seen, no, angular, spread, prior, pose_damping, kind, bend,
        video_s, frame_camera, place_gain, share, share_per_s, begin, block_camera, mid_s, half_s, first, degree,
        powers, order_coefficient, order_camera, size, mean, precision, camera, coefficients, own,
        max(1, limit - done), small, first_damping, history[done:], kept,
    )  # fmt: skip
    return status, done + count, camera, coefficients, own, corner, right, cost, frame_gain


@compiled
def _local_steps(step, motion, local, block_camera, order_camera, out):  # type: ignore[no-untyped-def]
    """Twin of `assembly.local_step`: the step of the local unknowns of every block into `out` (B, L)."""
    moved = len(motion)
    for b in range(len(block_camera)):
        for i in range(moved):
            out[b, i] = step[motion[i]] if motion[i] >= 0 else 0.0
        for q in range(local.shape[1]):
            s = 0.0
            for p in range(local.shape[2]):
                at = order_camera[block_camera[b], p]
                if at >= 0:
                    s += local[b, q, p] * step[at]
            out[b, moved + q] = s
