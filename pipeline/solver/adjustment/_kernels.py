"""Compiled twins of the plain numpy loops of `elimination`: tuples of bare arrays in, bare arrays out.

Callers check shapes; tests hold every function equal to its twin. Without numba `AVAILABLE` is false and the twins
are used. Up to LANES frames are linearised and eliminated together (`_lanes`); that width is the longest block's where
this is shorter, so that few lanes are empty.

C cameras, F frames, N targets, B blocks, K the greatest degree of a power series, L local unknowns of a block.
"""

# As in `_lanes`: spelt out, because that is what makes it fast.
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from calibration.foundation.arrays import (
    Bools2,
    Floats,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Ints,
    Ints1,
)  # fmt: skip
from calibration.foundation.compiled import compiled, inlined, is_compiled
from pipeline.solver.adjustment._lanes import NEAREST_COSINE, moments, sights, spins, turn, turns

__all__ = [
    "AVAILABLE", "Loosely", "Observed", "Point", "Runs", "block_normals", "kept_shape", "kept_steps", "room",
    "squared_lengths",
]  # fmt: skip

AVAILABLE = is_compiled(__name__)
"""Whether these are used."""
LANES = 64


class Observed(NamedTuple):
    """What is seen, and from where, as measured.

    cam_from_enu (F, 3, 3); position_m (F, 3)
    pose_rate    (F, 6) rad/s and m/s per second of log time; without frames where poses cannot be moved in time
    ray (F, N, 3), gain (F, N, 2, 3), seen (F, N): see `Frames`
    focal_effect (F, N, 2); without frames where lenses do not distort
    by_readout   (F, N, 2) derivative of residuals by the readout; without frames where none is refined
    place_gain   (F, N) sigmas per pixel of place error; without frames where there are no place errors
    angular      whether residuals are divided by the depth
    """

    cam_from_enu: Floats3
    position_m: Floats2
    pose_rate: Floats2
    ray: Floats3
    gain: Floats4
    focal_effect: Floats3
    by_readout: Floats3
    seen: Bools2
    place_gain: Floats2
    angular: bool


class Loosely(NamedTuple):
    """How loosely it binds: frames' own pose errors `spread`, `prior` (C, 6) and `damping` (`PoseError`); the loss."""

    spread: Floats2
    prior: Floats2
    damping: float
    kind: int
    bend: float


class Runs(NamedTuple):
    """Where the blocks are: begin (B + 1,) frames, camera (B,), u (F,) time inside the span, half_s (B,) its half."""

    begin: Ints1
    camera: Ints1
    u: Floats1
    half_s: Floats1


class Point(NamedTuple):
    """Where to linearise: series (B, N, 3, K + 1) m, bias (C, 6) rad and m, log focal (C,), own (F, 6) in sigmas.

    shift (F, N, 2) what place errors add to the residuals; without frames where there are none
    """

    series: Floats4
    bias: Floats2
    focal: Floats1
    own: Floats2
    shift: Floats3


@inlined
def _magnified(lens: Floats, f: int, n: int, phi: float, whole: float) -> tuple[float, float]:
    """Twin of `residuals.magnifications` for one sighting; `whole` is exp(phi)."""
    if len(lens) == 0:
        return whole, 1.0
    if phi == 0.0:
        return 1.0, lens[f, n, 0]
    return math.exp((lens[f, n, 0] + 0.5 * lens[f, n, 1] * phi) * phi), lens[f, n, 0] + lens[f, n, 1] * phi


@compiled
def _less(out: Floats, DX: Floats, axis: int, column: int) -> None:
    """out (w,) = minus the sum over targets of DX (3 N, 8, w) at one axis and column."""
    for lane in range(len(out)):
        out[lane] = -DX[axis, column, lane]
    for row in range(axis + 3, len(DX), 3):
        for lane in range(len(out)):
            out[lane] -= DX[row, column, lane]


@inlined
def _columns(
    n_targets: int, powers: int, rated: bool, rolled: bool, placed: bool, place: Ints, wide: Ints
) -> None:  # fmt: skip
    """Where each column of z begins among a block's local unknowns, and how many powers of u it has there.

    The columns are what the others are made of: targets 3 N, rotation 3, focal, and where there are
    any pose time, readout, place errors 2 N. Position and time follow from the targets' columns, see `_spread_out`.
    """
    nx = 3 * n_targets
    first_q = nx * powers
    for z in range(nx):
        place[z], wide[z] = z * powers, powers
    for i in range(3):
        place[nx + i], wide[nx + i] = first_q + i, 1
    place[nx + 3], wide[nx + 3] = first_q + 6, 1
    z = nx + 4
    if rated:
        place[z], wide[z] = first_q + 9, 2
        z += 1
    if rolled:
        place[z], wide[z] = first_q + 11, 1
        z += 1
    if placed:
        for i in range(2 * n_targets):
            place[z + i], wide[z + i] = first_q + 12 + 2 * i, 2


@compiled
def _spread_out(N: Floats, g: Floats, series: Floats, per_s: float, n_targets: int, powers: int) -> None:
    """Fills in place the rows and columns of a camera's position and of time, from those of the targets.

    To move a camera is to move all targets the other way; to move time is to move them along their motion:
    dX/dt = sum_k k m_k u^(k - 1) / half_s, so every such column is a sum of the targets' own columns.
    """
    first_q = 3 * n_targets * powers
    size = len(g)
    for d in range(2 + series.shape[1]):
        at = first_q + 3 + d if d < 3 else first_q + 4 + d
        for n in range(n_targets):
            for i in range(series.shape[1]):
                row = (3 * n + i) * powers
                if d < 3:
                    if i == d:
                        g[at] -= g[row]
                        for y in range(size):
                            N[at, y] -= N[row, y]
                    continue
                for k in range(1, powers):
                    weight = per_s * k * series[n, i, k]
                    source = row + k - 1 + d - 3
                    g[at] += weight * g[source]
                    for y in range(size):
                        N[at, y] += weight * N[source, y]
        for y in range(size):
            N[y, at] = N[at, y]
        own = 0.0
        for n in range(n_targets):
            for i in range(series.shape[1]):
                row = (3 * n + i) * powers
                if d < 3:
                    if i == d:
                        own -= N[row, at]
                    continue
                for k in range(1, powers):
                    own += per_s * k * series[n, i, k] * N[row + k - 1 + d - 3, at]
        N[at, at] = own


@compiled
def lanes_of(begin: Ints) -> int:
    """How many frames are done at once where blocks begin at `begin` (B + 1,)."""
    longest = 1
    for b in range(len(begin) - 1):
        longest = max(longest, begin[b + 1] - begin[b])
    return min(LANES, 4 * ((longest + 3) // 4))


@inlined
def _by_frame(rated: bool, rolled: bool) -> int:
    """How many columns each residual has: pose 6, focal, and pose time and readout where there are any."""
    return 7 + (1 if rated else 0) + (1 if rolled else 0)


@inlined
def _first_kept(n_targets: int, rated: bool, rolled: bool, placed: bool) -> int:
    """How many derivatives of residuals are kept, before L^-1 h and L."""
    columns: int = _by_frame(rated, rolled)
    return 2 * n_targets * columns + (n_targets if placed else 0)


@compiled
def kept_shape(begin: Ints1, n_targets: int, rated: bool, rolled: bool, placed: bool) -> tuple[int, int, int]:
    """Shape of what `block_normals` keeps: chunks, rows, lanes."""
    width, chunks = lanes_of(begin), 0
    for b in range(len(begin) - 1):
        chunks += (begin[b + 1] - begin[b] + width - 1) // width
    return chunks, _first_kept(n_targets, rated, rolled, placed) + 27, width


@compiled
def room(chunks: int, rows: int, lanes: int) -> Floats:
    """Memory as the system gives it."""
    return np.empty((chunks, rows, lanes))


@compiled
def block_normals(
    observed: Observed, loosely: Loosely, runs: Runs, point: Point, kept: Floats3
) -> tuple[Floats, Floats, float, float]:
    """Twin of `elimination.block_normals_plain`: normal (B, L, L), gradient (B, L), cost, frame gain.

    Where `kept` (of `kept_shape`) has chunks, what `kept_steps` needs of every frame goes there: the residuals'
    derivatives by its pose, focal length, log time and readout, and by place errors; L^-1 h, the inverse of the
    diagonal of L, the factor of H, and L below it.
    """
    cam_from_enu, position, rate, ray = observed.cam_from_enu, observed.position_m, observed.pose_rate, observed.ray
    gain, lens, place_gain, angular = observed.gain, observed.focal_effect, observed.place_gain, observed.angular
    by_readout = observed.by_readout
    spread, prior, damping, kind, bend = loosely
    begin, camera, time_u, half_s = runs
    series, bias, focal, own, shift = point
    keep, rated, rolled = len(kept) > 0, len(rate) > 0, len(by_readout) > 0
    axes, six = position.shape[1], spread.shape[1]
    n_blocks, n_targets, powers = len(camera), ray.shape[1], series.shape[3]
    placed = len(shift) > 0
    nx = 3 * n_targets
    nq = _by_frame(rated, rolled)
    first_place = nx + nq - 3
    nz = first_place + (2 * n_targets if placed else 0)
    nk = max(2 * powers - 1, 5)
    size = nx * powers + 12 + (4 * n_targets if placed else 0)
    column, wide = np.zeros(nz, np.int64), np.zeros(nz, np.int64)
    _columns(n_targets, powers, rated, rolled, placed, column, wide)
    width = lanes_of(begin)
    normal = np.zeros((n_blocks, size, size))
    gradient = np.zeros((n_blocks, size))
    rows, first_kept = 2 * n_targets, _first_kept(n_targets, rated, rolled, placed)
    R, DX, DQ = np.empty((rows, width)), np.empty((nx, 9, width)), np.empty((9, 9, width))
    gz, hq, H, W = np.empty((nz, width)), np.empty((6, width)), np.empty((6, 6, width)), np.empty((nz, 6, width))
    pw, m = np.empty((nk, width)), np.empty(width)
    turned, left, error = np.empty((9, width)), np.empty((9, width)), np.empty((6, width))
    spin, root, work = np.empty((3, width)), np.empty(width), np.empty((16, width))
    # what lanes without a frame hold must be finite
    measured, place, mine = np.zeros((9, width)), np.zeros((3, width)), np.zeros((6, width))
    gain_at, ray_at = np.zeros((n_targets, 6, width)), np.zeros((n_targets, 3, width))
    shift_at, worth, rate_at = np.zeros((n_targets, 2, width)), np.zeros((n_targets, width)), np.zeros((6, width))
    growth_at, lensed = np.ones((n_targets, width)), len(lens) > 0
    own_store = np.empty((first_kept + 27, width))
    chunk = -1
    moment = np.empty(nk)
    cost = frame_gain = 0.0
    for b in range(n_blocks):
        c = camera[b]
        still = True
        for i in range(six):
            still = still and spread[c, i] == 0.0
        whole = math.exp(focal[c])
        per_s = 1.0 / half_s[b]
        N, g = normal[b], gradient[b]
        for low in range(begin[b], begin[b + 1], width):
            lanes = min(width, begin[b + 1] - low)
            chunk += 1
            store = kept[chunk] if keep else own_store
            PG = store[rows * nq :]
            wh, inverse = store[first_kept:], store[first_kept + 6 :]
            # --- linearise; lanes without a frame have no gain
            for lane in range(lanes, width):
                pw[0, lane] = pw[1, lane] = 0.0
                for i in range(six):
                    mine[i, lane] = 0.0
                for n in range(n_targets):
                    worth[n, lane] = shift_at[n, 0, lane] = shift_at[n, 1, lane] = 0.0
                    for i in range(six):
                        gain_at[n, i, lane] = 0.0
            for lane in range(lanes):
                f = low + lane
                pw[0, lane], pw[1, lane] = 1.0, time_u[f]
                for i in range(six):
                    mine[i, lane] = own[f, i]
                for i in range(axes):
                    place[i, lane] = position[f, i]
                    for j in range(axes):
                        measured[3 * i + j, lane] = cam_from_enu[f, i, j]
                if rated:
                    for i in range(six):
                        rate_at[i, lane] = rate[f, i]
                for n in range(n_targets):
                    factor, growth_at[n, lane] = _magnified(lens, f, n, focal[c], whole)
                    for i in range(axes):
                        larger = factor if i < 2 else 1.0
                        ray_at[n, i, lane] = larger * ray[f, n, i]
                        gain_at[n, i, lane] = larger * gain[f, n, 0, i]
                        gain_at[n, 3 + i, lane] = larger * gain[f, n, 1, i]
                if placed:
                    for n in range(n_targets):
                        shift_at[n, 0, lane], shift_at[n, 1, lane] = shift[f, n, 0], shift[f, n, 1]
                        worth[n, lane] = place_gain[f, n]
            for k in range(2, nk):
                for lane in range(width):
                    pw[k, lane] = pw[k - 1, lane] * pw[1, lane]
            for i in range(six):
                for lane in range(width):
                    error[i, lane] = bias[c, i] + spread[c, i] * mine[i, lane]
                squares = 0.0
                for lane in range(width):
                    squares += mine[i, lane] * mine[i, lane]
                cost += 0.5 * prior[c, i] * squares
            for i in range(axes):
                for lane in range(width):
                    place[i, lane] += error[3 + i, lane]
            turns(error, measured, turned, left, work, axes)
            if rated:
                spins(turned, measured, rate_at, work, spin, axes)
            for n in range(n_targets):
                cost += sights(
                    series[b, n], pw[1], turned, left, place, lensed, growth_at[n], gain_at[n], ray_at[n], shift_at[n],
                    angular, kind, bend, rated, spin, rate_at, store[2 * n * nq : (2 * n + 2) * nq],
                    R[2 * n : 2 * n + 2], root, work, axes,
                )  # fmt: skip
                if rolled:
                    for i in range(2):
                        J = store[(2 * n + i + 1) * nq - 1]
                        for lane in range(lanes):
                            J[lane] = by_readout[low + lane, n, i] * root[lane]
                        for lane in range(lanes, width):
                            J[lane] = 0.0
                if placed:
                    for lane in range(width):
                        PG[n, lane] = worth[n, lane] * root[lane]
            # --- their products, all lanes at once; the derivative by a target's place is minus that by the camera's
            for n in range(n_targets):
                x = 2 * n
                for i in range(axes):
                    z = 3 * n + i
                    for lane in range(width):
                        gz[z, lane] = -(
                            store[x * nq + 3 + i, lane] * R[x, lane]
                            + store[(x + 1) * nq + 3 + i, lane] * R[x + 1, lane]
                        )
                    for j in range(nq):
                        if j < 3 or j > 5 or j - 3 <= i:
                            for lane in range(width):
                                DX[z, j, lane] = -(
                                    store[x * nq + 3 + i, lane] * store[x * nq + j, lane]
                                    + store[(x + 1) * nq + 3 + i, lane] * store[(x + 1) * nq + j, lane]
                                )
                    for j in range(i):
                        for lane in range(width):
                            DX[3 * n + j, 3 + i, lane] = DX[z, 3 + j, lane]
            for i in range(nq):
                if 3 <= i < 6:
                    for lane in range(width):
                        hq[i, lane] = -gz[i - 3, lane]
                    for row in range(i, nx, 3):
                        for lane in range(width):
                            hq[i, lane] -= gz[row, lane]
                    for j in range(i + 1):
                        _less(DQ[i, j], DX, i - 3, j)
                    continue
                z = nx + (i if i < 3 else i - 3)
                for lane in range(width):
                    gz[z, lane] = store[i, lane] * R[0, lane]
                for row in range(1, 2 * n_targets):
                    for lane in range(width):
                        gz[z, lane] += store[row * nq + i, lane] * R[row, lane]
                if i < 3:
                    for lane in range(width):
                        hq[i, lane] = gz[z, lane]
                for j in range(i + 1):
                    if 3 <= j < 6:
                        _less(DQ[i, j], DX, j - 3, i)
                        continue
                    for lane in range(width):
                        DQ[i, j, lane] = store[i, lane] * store[j, lane]
                    for row in range(1, 2 * n_targets):
                        for lane in range(width):
                            DQ[i, j, lane] += store[row * nq + i, lane] * store[row * nq + j, lane]
            for z in range(first_place, nz):
                row = z - first_place
                for lane in range(width):
                    gz[z, lane] = PG[row // 2, lane] * R[row, lane]
            # --- eliminate the frames' own errors
            if still:
                inverse[0] = 0.0
            if not still:
                for i in range(six):
                    si = spread[c, i]
                    for j in range(i + 1):
                        sij = si * spread[c, j]
                        for lane in range(width):
                            H[i, j, lane] = DQ[i, j, lane] * sij
                    for lane in range(width):
                        own_part = H[i, i, lane] * (1.0 + damping) + prior[c, i]
                        H[i, i, lane] = own_part if own_part > 0.0 else 1.0
                        wh[i, lane] = hq[i, lane] * si + prior[c, i] * mine[i, lane]
                for i in range(six):
                    for j in range(i):
                        for k in range(j):
                            for lane in range(width):
                                H[i, j, lane] -= H[i, k, lane] * H[j, k, lane]
                        for lane in range(width):
                            H[i, j, lane] *= inverse[j, lane]
                    for k in range(i):
                        for lane in range(width):
                            H[i, i, lane] -= H[i, k, lane] * H[i, k, lane]
                    for lane in range(width):
                        inverse[i, lane] = 1.0 / math.sqrt(H[i, i, lane])
                for i in range(six):
                    for k in range(i):
                        for lane in range(width):
                            wh[i, lane] -= H[i, k, lane] * wh[k, lane]
                    for lane in range(width):
                        wh[i, lane] *= inverse[i, lane]
                        frame_gain += 0.5 * wh[i, lane] * wh[i, lane]
                for z in range(nz):
                    for i in range(six):
                        si = spread[c, i]
                        if z < nx:
                            for lane in range(width):
                                W[z, i, lane] = DX[z, i, lane] * si
                        elif z >= first_place:
                            row = z - first_place
                            for lane in range(width):
                                W[z, i, lane] = PG[row // 2, lane] * store[row * nq + i, lane] * si
                        else:
                            q = z - nx if z - nx < 3 else z - nx + 3
                            high, under = max(q, i), min(q, i)
                            for lane in range(width):
                                W[z, i, lane] = DQ[high, under, lane] * si
                        for k in range(i):
                            for lane in range(width):
                                W[z, i, lane] -= H[i, k, lane] * W[z, k, lane]
                        for lane in range(width):
                            W[z, i, lane] *= inverse[i, lane]
                    for i in range(six):
                        for lane in range(width):
                            gz[z, lane] -= W[z, i, lane] * wh[i, lane]
                if keep:
                    for i in range(six):
                        for j in range(i):
                            store[first_kept + 12 + (i * (i - 1)) // 2 + j] = H[i, j]
            # --- moments
            for z in range(nz):
                at_z, wide_z = column[z], wide[z]
                for k in range(wide_z):
                    s = 0.0
                    for lane in range(width):
                        s += gz[z, lane] * pw[k, lane]
                    g[at_z + k] += s
                for y in range(z + 1):
                    apart = True
                    if z < nx:
                        if z // 3 == y // 3:
                            apart = False
                            for lane in range(width):
                                m[lane] = -DX[z, 3 + y % 3, lane]
                    elif z < first_place:
                        apart = False
                        q = z - nx if z - nx < 3 else z - nx + 3
                        if y < nx:
                            for lane in range(width):
                                m[lane] = DX[y, q, lane]
                        else:
                            p = y - nx if y - nx < 3 else y - nx + 3
                            for lane in range(width):
                                m[lane] = DQ[q, p, lane]
                    else:
                        row = z - first_place
                        n = row // 2
                        if y < nx:
                            if y // 3 == n:
                                apart = False
                                for lane in range(width):
                                    m[lane] = -PG[n, lane] * store[row * nq + 3 + y % 3, lane]
                        elif y < first_place:
                            apart = False
                            p = y - nx if y - nx < 3 else y - nx + 3
                            for lane in range(width):
                                m[lane] = PG[n, lane] * store[row * nq + p, lane]
                        elif y == z:
                            apart = False
                            for lane in range(width):
                                m[lane] = PG[n, lane] * PG[n, lane]
                    if apart:
                        if still:
                            continue
                        for lane in range(width):
                            m[lane] = 0.0
                    if not still:
                        for lane in range(width):
                            m[lane] -= (
                                W[z, 0, lane] * W[y, 0, lane]
                                + W[z, 1, lane] * W[y, 1, lane]
                                + W[z, 2, lane] * W[y, 2, lane]
                                + W[z, 3, lane] * W[y, 3, lane]
                                + W[z, 4, lane] * W[y, 4, lane]
                                + W[z, 5, lane] * W[y, 5, lane]
                            )
                    at_y, wide_y = column[y], wide[y]
                    moments(m, pw, wide_z + wide_y - 1, moment)
                    for i in range(wide_z):
                        for j in range(wide_y):
                            N[at_z + i, at_y + j] += moment[i + j]
        for i in range(size):
            for j in range(i):
                N[j, i] = N[i, j]
        _spread_out(N, g, series[b], per_s, n_targets, powers)
    return normal, gradient, cost, frame_gain


@compiled
def kept_steps(
    kept: Floats3,
    rated: bool,
    rolled: bool,
    placed: bool,
    spread: Floats2,
    runs: Runs,
    series: Floats4,
    step: Floats2,
    own: Floats2,
    out: Floats2,
) -> None:
    """`own` + du into `out`: du as `frame_steps`, from what `block_normals` kept: - L'^-1 (L^-1 h + L^-1 E dz)."""
    begin, camera, time_u, half_s = runs
    n_targets, powers, axes, six = series.shape[1], series.shape[3], series.shape[2], spread.shape[1]
    first_q, nq = 3 * n_targets * powers, _by_frame(rated, rolled)
    at = _first_kept(n_targets, rated, rolled, placed)
    width = kept.shape[2]
    right, dx, s, u = np.empty((6, width)), np.empty((3, width)), np.empty(width), np.zeros(width)
    d = np.zeros(step.shape[1])
    chunk = -1
    for b in range(len(begin) - 1):
        given, per_s = step[b], 1.0 / half_s[b]
        for i in range(len(d)):
            d[i] = given[i]
        for n in range(n_targets):
            for i in range(axes):
                row = (3 * n + i) * powers
                d[row] -= given[first_q + 3 + i]
                for k in range(1, powers):
                    speed = per_s * k * series[b, n, i, k]
                    d[row + k - 1] += speed * given[first_q + 7]
                    d[row + k] += speed * given[first_q + 8]
        for low in range(begin[b], begin[b + 1], width):
            chunk += 1
            store, lanes = kept[chunk], min(width, begin[b + 1] - low)
            if store[at + 6, 0] == 0.0:
                for f in range(low, low + lanes):
                    for i in range(six):
                        out[f, i] = own[f, i]
                continue
            for lane in range(lanes):
                u[lane] = time_u[low + lane]
            for i in range(six):
                for lane in range(width):
                    right[i, lane] = 0.0
            for n in range(n_targets):
                for i in range(axes):
                    row = (3 * n + i) * powers
                    for lane in range(width):
                        dx[i, lane] = d[row + powers - 1]
                    for k in range(powers - 2, -1, -1):
                        for lane in range(width):
                            dx[i, lane] = dx[i, lane] * u[lane] + d[row + k]
                for row in range(2 * n, 2 * n + 2):
                    J = store[row * nq : row * nq + nq]
                    for lane in range(width):
                        s[lane] = (
                            J[0, lane] * d[first_q] + J[1, lane] * d[first_q + 1] + J[2, lane] * d[first_q + 2]
                            + J[6, lane] * d[first_q + 6]
                            - J[3, lane] * dx[0, lane] - J[4, lane] * dx[1, lane] - J[5, lane] * dx[2, lane]
                        )  # fmt: skip
                    if rated:
                        for lane in range(width):
                            s[lane] += J[7, lane] * (d[first_q + 9] + u[lane] * d[first_q + 10])
                    if rolled:
                        for lane in range(width):
                            s[lane] += J[nq - 1, lane] * d[first_q + 11]
                    if placed:
                        k = first_q + 12 + 2 * row
                        for lane in range(width):
                            s[lane] += store[2 * n_targets * nq + n, lane] * (d[k] + u[lane] * d[k + 1])
                    for i in range(six):
                        for lane in range(width):
                            right[i, lane] += J[i, lane] * s[lane]
            for i in range(six):
                si = spread[camera[b], i]
                for lane in range(width):
                    right[i, lane] *= si
                for k in range(i):
                    for lane in range(width):
                        right[i, lane] -= store[at + 12 + (i * (i - 1)) // 2 + k, lane] * right[k, lane]
                for lane in range(width):
                    right[i, lane] *= store[at + 6 + i, lane]
            for i in range(six):
                for lane in range(width):
                    right[i, lane] += store[at + i, lane]
            for i in range(six - 1, -1, -1):
                for k in range(i + 1, six):
                    for lane in range(width):
                        right[i, lane] -= store[at + 12 + (k * (k - 1)) // 2 + i, lane] * right[k, lane]
                for lane in range(width):
                    right[i, lane] *= store[at + 6 + i, lane]
            for lane in range(lanes):
                for i in range(six):
                    out[low + lane, i] = own[low + lane, i] - right[i, lane]


@compiled
def squared_lengths(observed: Observed, spread: Floats2, runs: Runs, point: Point, out: Floats2) -> None:
    """Squared lengths of the residuals into `out` (F, N), in sigmas, whatever the loss; zero where unseen."""
    error, turned = np.zeros(6), np.zeros((3, 3))
    axes, powers = observed.position_m.shape[1], point.series.shape[3]
    away, y = np.zeros(3), np.zeros(3)
    for b in range(len(runs.camera)):
        c = runs.camera[b]
        whole = math.exp(point.focal[c])
        for f in range(runs.begin[b], runs.begin[b + 1]):
            for i in range(2 * axes):
                error[i] = point.bias[c, i] + spread[c, i] * point.own[f, i]
            turn(error, observed.cam_from_enu[f], turned)
            for n in range(observed.ray.shape[1]):
                out[f, n] = 0.0
                if not observed.seen[f, n]:
                    continue
                for i in range(axes):
                    away[i] = point.series[b, n, i, powers - 1]
                    for k in range(powers - 2, -1, -1):
                        away[i] = away[i] * runs.u[f] + point.series[b, n, i, k]
                    away[i] -= observed.position_m[f, i] + error[3 + i]
                for i in range(axes):
                    y[i] = 0.0
                    for j in range(axes):
                        y[i] += turned[i, j] * away[j]
                length = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
                factor, _ = _magnified(observed.focal_effect, f, n, point.focal[c], whole)
                y[0] *= factor
                y[1] *= factor
                inverse = 1.0
                if observed.angular:
                    ray = observed.ray[f, n]
                    along = ray[0] * y[0] + ray[1] * y[1] + ray[2] * y[2]
                    inverse = 1.0 / max(along, max(NEAREST_COSINE * length, 1e-9))
                for row in range(2):
                    g = observed.gain[f, n, row]
                    r = (g[0] * y[0] + g[1] * y[1] + g[2] * y[2]) * inverse
                    if len(point.shift) > 0:
                        r += point.shift[f, n, row]
                    out[f, n] += r * r
