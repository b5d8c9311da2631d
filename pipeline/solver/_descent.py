"""Compiled twin of the whole descent where the unknowns are few: polynomials, affine clocks, poses held in log time.

A small flight (two cameras, fifty frames) is adjusted in less time than Python needs to look at its arrays, so for such
models one call does all of `levenberg.levenberg_marquardt`: linearise, damp, step, compare. The elimination itself is
`_kernels.block_normals`; the plain loop stays the reference, and tests hold the two to the same path.

`no` is False, handed in so that it is no literal: the elimination is compiled for one set of types only.

Bare arrays in, bare arrays out; `dense.py` is the only caller and checks them.
"""

# As in `_kernels`: spelt out, because that is what makes it fast.
from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import compiled, inlined
from pipeline.solver._kernels import _sight, _turn, assemble, block_normals, kept_steps

CONVERGED, LIMIT, STALLED = 0, 1, 2
FIRST_DAMPING = 1e-4
"""Relative. A step damped by no more than this is as good as the full one when it says that nothing is to gain."""
OFFSET, SCALE, START, FOCAL = 7, 8, 9, 6


@compiled
def _places(order_coefficient, order_camera, first, degree, block_camera):  # type: ignore[no-untyped-def]
    """Twin of `assembly.global_places` for one span and no drift."""
    width = 0
    for n in range(len(first)):
        width += 3 * (degree[n] + 1)
    out = np.full((len(block_camera), width + 12), -1)
    for b in range(len(block_camera)):
        column = 0
        for n in range(len(first)):
            for axis in range(3):
                for a in range(degree[n] + 1):
                    out[b, column] = order_coefficient[first[n] + a, axis]
                    column += 1
        for p in range(10):
            out[b, column + p] = order_camera[block_camera[b], p]
    return out


@compiled
def _where(video_s, frame_camera, camera, begin, block_camera, mid_s, half_s, u, local):  # type: ignore[no-untyped-def]
    """Times u (F,) inside the span, and the chain rule `local` (B, 11, 12), at the clocks of `camera` (C, W)."""
    for f in range(len(video_s)):
        c = frame_camera[f]
        u[f] = (video_s[f] * (1.0 + camera[c, SCALE]) + camera[c, OFFSET] - mid_s) / half_s
    local[:] = 0.0
    for b in range(len(block_camera)):
        slope = half_s / (1.0 + camera[block_camera[b], SCALE])
        middle = video_s[begin[b]] - u[begin[b]] * slope
        for i in range(FOCAL + 1):
            local[b, i, i] = 1.0
        local[b, 7, OFFSET] = local[b, 9, START] = 1.0
        local[b, 7, SCALE] = local[b, 9, SCALE] = middle
        local[b, 8, SCALE] = local[b, 10, SCALE] = slope


@compiled
def _series(coefficients, transform, first, degree, out):  # type: ignore[no-untyped-def]
    """Power series `out` (B, N, 3, K + 1) of all targets, the same in every block."""
    for n in range(len(first)):
        for axis in range(3):
            for k in range(out.shape[3]):
                s = 0.0
                for a in range(degree[n] + 1):
                    s += transform[n, k, a] * coefficients[first[n] + a, axis]
                for b in range(len(out)):
                    out[b, n, axis, k] = s


@compiled
def _factor(corner, amount, lower):  # type: ignore[no-untyped-def]
    """Cholesky of corner + diag(amount) into `lower`; the smallest squared pivot, zero where there is none."""
    smallest = np.inf
    for i in range(len(corner)):
        for j in range(i + 1):
            s = corner[i, j]
            for k in range(j):
                s -= lower[i, k] * lower[j, k]
            if j < i:
                lower[i, j] = s * lower[j, j]
            else:
                s += amount[i]
                if not s > 0.0:
                    return 0.0
                smallest = min(smallest, s)
                lower[i, i] = 1.0 / math.sqrt(s)
    return smallest


@compiled
def _solved(lower, right, out):  # type: ignore[no-untyped-def]
    """out = - (L L')^-1 right; the diagonal of `lower` holds its inverse."""
    n = len(right)
    for i in range(n):
        s = -right[i]
        for k in range(i):
            s -= lower[i, k] * out[k]
        out[i] = s * lower[i, i]
    for i in range(n - 1, -1, -1):
        s = out[i] * lower[i, i]
        out[i] = s
        for k in range(i):
            out[k] -= lower[i, k] * s


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


@compiled
def across(ray, seen):  # type: ignore[no-untyped-def]
    """Twin of `layout.metric`'s gains (F, N, 2, 3): two unit rows across every ray, zero where unseen."""
    out = np.zeros((ray.shape[0], ray.shape[1], 2, 3))
    for f in range(ray.shape[0]):
        for n in range(ray.shape[1]):
            if not seen[f, n]:
                continue
            d = ray[f, n]
            least = 0
            for i in range(1, 3):
                if abs(d[i]) < abs(d[least]):
                    least = i
            i, j = (least + 1) % 3, (least + 2) % 3
            length = math.sqrt(d[i] * d[i] + d[j] * d[j])
            one = out[f, n, 0]
            one[i], one[j] = d[j] / length, -d[i] / length
            for k in range(3):
                p, q = (k + 1) % 3, (k + 2) % 3
                out[f, n, 1, k] = d[p] * one[q] - d[q] * one[p]
    return out


@compiled
def _motion_step(corner, right, order_coefficient, rank, lower, step, coefficients):  # type: ignore[no-untyped-def]
    """Moves `coefficients` to the solution; returns the smallest pivot, -1 where one is touched by nothing."""
    size = len(right)
    scale = np.zeros(size)
    for i in range(size):
        if not corner[i, i] > 0.0:
            return -1.0
        scale[i] = 1.0 / math.sqrt(corner[i, i])
    for i in range(size):
        right[i] *= scale[i]
        for j in range(size):
            corner[i, j] *= scale[i] * scale[j]
    pivot = _factor(corner, np.full(size, rank), lower)
    if pivot > 0.0:
        _solved(lower, right, step)
        for i in range(len(coefficients)):
            for axis in range(3):
                at = order_coefficient[i, axis]
                coefficients[i, axis] += scale[at] * step[at]
    return pivot


@compiled
def descend(  # type: ignore[no-untyped-def]
    cam_from_enu, position, rate, ray, gain, seen, no, angular, spread, prior, pose_damping, kind, bend, video_s,
    frame_camera, begin, block_camera, mid_s, half_s, transform, first, degree, order_coefficient, order_camera, size,
    mean, precision, first_camera, first_coefficients, first_own, limit, small, first_damping, history,
    rank,
):  # fmt: skip
    """Twin of `levenberg.levenberg_marquardt`: (status, iterations), the point, and the linear system there.

    history (limit,) takes the better cost of every iteration. With `rank` above zero: instead one linear step of the
    motion alone (twin of `intersection._motion_step`), with the smallest pivot in place of the cost.
    """
    frames, blocks, targets = len(video_s), len(block_camera), len(first)
    powers = transform.shape[1]
    keep = no
    for c in range(len(spread)):
        for i in range(6):
            keep = keep or spread[c, i] != 0.0
    wide = 6 * (3 * targets + 4) + 27
    nothing, no_gain = np.zeros((0, targets, 2)), np.zeros((0, targets))
    kept, kept_there = np.empty((frames if keep else 0, wide)), np.empty((frames if keep else 0, wide))
    u, u_there, local = np.zeros(frames), np.zeros(frames), np.zeros((blocks, 11, 12))
    local_there = local.copy()
    series = np.zeros((blocks, targets, 3, powers))
    series_there = series.copy()
    half, span = np.full(blocks, half_s), np.zeros(blocks, np.int64)
    places = _places(order_coefficient, order_camera, first, degree, block_camera)
    transforms = transform.reshape((1, *transform.shape))
    camera, coefficients, own = first_camera.copy(), first_coefficients.copy(), first_own.copy()
    camera_there, coefficients_there = camera.copy(), coefficients.copy()
    amount, step, lower = np.zeros(size), np.zeros(size), np.zeros((size, size))
    local_size = 3 * targets * powers + 11
    moved = np.zeros((blocks, local_size))
    damping, growth = first_damping, 2.0

    _where(video_s, frame_camera, camera, begin, block_camera, mid_s, half_s, u, local)
    _series(coefficients, transform, first, degree, series)
    normal, gradient, cost, frame_gain = block_normals(
        cam_from_enu, position, rate, no, ray, gain, seen, angular, spread, prior, pose_damping, kind, bend,
        series, camera[:, :6].copy(), camera[:, FOCAL].copy(), own, nothing, no_gain, begin, block_camera, u, half,
        keep, kept,
    )  # fmt: skip
    _, _, corner, right = assemble(normal, gradient, transforms, degree, span, local, places, 0, size, 0)
    cost += _with_priors(camera, mean, precision, order_camera, corner, right)
    if rank > 0.0:
        pivot = _motion_step(corner, right, order_coefficient, rank, lower, step, coefficients)
        return CONVERGED, 1, camera, coefficients, own, corner, right, pivot, 0.0
    status, iteration = LIMIT, limit
    for count in range(1, limit + 1):
        greatest = 0.0
        for i in range(size):
            greatest = max(greatest, corner[i, i])
        for i in range(size):
            amount[i] = damping * max(corner[i, i], 1e-12 * max(1e-300, greatest))
        history[count - 1] = cost
        if _factor(corner, amount, lower) > 0.0:
            _solved(lower, right, step)
            foretold = frame_gain
            for i in range(size):
                foretold += 0.5 * step[i] * (amount[i] * step[i] - right[i])
            if foretold <= small * cost and damping <= FIRST_DAMPING:
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
            own_there = own
            if keep:
                _local_steps(step, places, transform, degree, local, moved)
                own_there = own + kept_steps(kept, seen, no, no, begin, u, half, series, moved)
            _where(video_s, frame_camera, camera_there, begin, block_camera, mid_s, half_s, u_there, local_there)
            _series(coefficients_there, transform, first, degree, series_there)
            normal, gradient, cost_there, gain_there = block_normals(
                cam_from_enu, position, rate, no, ray, gain, seen, angular, spread, prior, pose_damping, kind, bend,
                series_there, camera_there[:, :6].copy(), camera_there[:, FOCAL].copy(), own_there, nothing, no_gain,
                begin, block_camera, u_there, half, keep, kept_there,
            )  # fmt: skip
            _, _, corner_there, right_there = assemble(
                normal, gradient, transforms, degree, span, local_there, places, 0, size, 0
            )
            cost_there += _with_priors(camera_there, mean, precision, order_camera, corner_there, right_there)
            ratio = (cost - cost_there) / max(foretold, 1e-300)
            if math.isfinite(cost_there) and ratio > 0.0:
                done = abs(cost - cost_there) <= small * cost
                cost, frame_gain, corner, right, own = cost_there, gain_there, corner_there, right_there, own_there
                camera, camera_there = camera_there, camera
                coefficients, coefficients_there = coefficients_there, coefficients
                kept, kept_there = kept_there, kept
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
        damping, growth = damping * growth, growth * 2
        if damping > 1e12:
            status, iteration = STALLED, count
            break
    return status, iteration, camera, coefficients, own, corner, right, cost, frame_gain


@compiled
def median_length(  # type: ignore[no-untyped-def]
    cam_from_enu, position, ray, gain, seen, angular, spread, video_s, frame_camera, mid_s, half_s, transform, first,
    degree, camera, coefficients, own,
):  # fmt: skip
    """Twin of the median of `beginning.residual_lengths`."""
    series = np.zeros((1, len(first), 3, transform.shape[1]))
    _series(coefficients, transform, first, degree, series)
    Q, Jx, r, unmoved = np.zeros((2, 9)), np.zeros((2, 3)), np.zeros(9), np.zeros(2)
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
                _sight(
                    series[0], n, u, 1.0, turned, left, place, math.exp(camera[c, FOCAL]), gain[f, n], ray[f, n],
                    unmoved, angular, 0, 1.0, Q, Jx, r,
                )  # fmt: skip
                lengths[count] = math.sqrt(r[0] * r[0] + r[1] * r[1])
                count += 1
    return np.median(lengths[:count])


@compiled
def _local_steps(step, places, transform, degree, local, out):  # type: ignore[no-untyped-def]
    """Twin of `assembly.local_step`: the step of the local unknowns of every block into `out` (B, L)."""
    powers, targets = transform.shape[1], len(degree)
    first_q = 3 * targets * powers
    for b in range(len(places)):
        column = 0
        for n in range(targets):
            for axis in range(3):
                row = (3 * n + axis) * powers
                for k in range(powers):
                    s = 0.0
                    for a in range(degree[n] + 1):
                        at = places[b, column + a]
                        if at >= 0:
                            s += transform[n, k, a] * step[at]
                    out[b, row + k] = s
                column += degree[n] + 1
        for q in range(11):
            s = 0.0
            for p in range(12):
                at = places[b, column + p]
                if at >= 0:
                    s += local[b, q, p] * step[at]
            out[b, first_q + q] = s
