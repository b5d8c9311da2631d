"""Compiled twins of the plain numpy loops of `elimination` and `assembly`: bare arrays in, bare arrays out.

Callers check shapes; tests hold every function equal to its twin. Without numba `AVAILABLE` is false and the twins
are used. Compiled code is cached beside this file, so only the first call ever compiles.

Up to LANES frames are linearised and eliminated together, the innermost loop always running over frames that lie side
by side in memory and writing one row, which the compiler turns into vector instructions. That width is
the longest block's where this is shorter, so that few lanes are empty.
"""

# The arithmetic is spelt out in scalars and packed triangles: that is what makes it fast.
from __future__ import annotations

import math

import numpy as np

from calibration.foundation.compiled import AVAILABLE, compiled, inlined

__all__ = ["AVAILABLE", "assemble", "block_normals", "frame_steps", "kept_shape", "kept_steps", "room", "warm"]

LANES = 64
NEAREST_COSINE = 0.05


@inlined
def _turn(w, measured, turned, left):  # type: ignore[no-untyped-def]
    """exp(w) @ measured into `turned` (3, 3), and the left Jacobian of w into `left` (3, 3)."""
    x, y, z = w[0], w[1], w[2]
    square = x * x + y * y + z * z
    if square < 1e-2:
        s = 1.0 + square * (-1 / 6 + square * (1 / 120 + square * (-1 / 5040 + square / 362880)))
        a = 0.5 + square * (-1 / 24 + square * (1 / 720 + square * (-1 / 40320 + square / 3628800)))
        b = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 + square * (-1 / 362880 + square / 39916800)))
    else:
        angle = math.sqrt(square)
        s = math.sin(angle) / angle
        a = (1.0 - math.cos(angle)) / square
        b = (1.0 - s) / square
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    e00, e11, e22 = 1.0 - a * (yy + zz), 1.0 - a * (xx + zz), 1.0 - a * (xx + yy)
    e01, e02, e12 = a * xy - s * z, a * xz + s * y, a * yz - s * x
    e10, e20, e21 = a * xy + s * z, a * xz - s * y, a * yz + s * x
    for j in range(3):
        m0, m1, m2 = measured[0, j], measured[1, j], measured[2, j]
        turned[0, j] = e00 * m0 + e01 * m1 + e02 * m2
        turned[1, j] = e10 * m0 + e11 * m1 + e12 * m2
        turned[2, j] = e20 * m0 + e21 * m1 + e22 * m2
    left[0, 0], left[1, 1], left[2, 2] = 1.0 - b * (yy + zz), 1.0 - b * (xx + zz), 1.0 - b * (xx + yy)
    left[0, 1], left[0, 2], left[1, 2] = b * xy - a * z, b * xz + a * y, b * yz - a * x
    left[1, 0], left[2, 0], left[2, 1] = b * xy + a * z, b * xz - a * y, b * yz + a * x


@inlined
def _stretch(lens, f, n, phi, whole):  # type: ignore[no-untyped-def]
    """Twin of `residuals.stretches` for one sighting; `whole` is exp(phi)."""
    if len(lens) == 0:
        return whole, 1.0
    if phi == 0.0:
        return 1.0, lens[f, n, 0]
    return math.exp((lens[f, n, 0] + 0.5 * lens[f, n, 1] * phi) * phi), lens[f, n, 0] + lens[f, n, 1] * phi


@inlined
def _sight(  # type: ignore[no-untyped-def]
    series, n, u, per_s, turned, left, place, stretch, growth, gain, ray, shift, angular, kind, bend, Q, Jx, r
):
    """One sighting: residual `r` (2,), `Jx` (2, 3), `Q` (2, 9), all times the root of the robust weight.

    Q holds the derivatives by rotation, position, focal and time; the column of pose time is the caller's. `shift` (2,)
    is added to the residual. r[8] is the root itself. Returns half of rho.
    """
    top = series.shape[2] - 1
    p0, p1, p2 = series[n, 0, top], series[n, 1, top], series[n, 2, top]
    v0 = v1 = v2 = 0.0
    for k in range(top - 1, -1, -1):
        v0, v1, v2 = v0 * u + p0, v1 * u + p1, v2 * u + p2
        p0, p1, p2 = p0 * u + series[n, 0, k], p1 * u + series[n, 1, k], p2 * u + series[n, 2, k]
    v0, v1, v2 = v0 * per_s, v1 * per_s, v2 * per_s
    a0, a1, a2 = p0 - place[0], p1 - place[1], p2 - place[2]
    y0 = turned[0, 0] * a0 + turned[0, 1] * a1 + turned[0, 2] * a2
    y1 = turned[1, 0] * a0 + turned[1, 1] * a1 + turned[1, 2] * a2
    y2 = turned[2, 0] * a0 + turned[2, 1] * a1 + turned[2, 2] * a2
    s0, s1 = y0 * stretch, y1 * stretch
    inverse = 1.0
    if angular:
        along = ray[0] * s0 + ray[1] * s1 + ray[2] * y2
        nearest = NEAREST_COSINE * math.sqrt(y0 * y0 + y1 * y1 + y2 * y2)
        inverse = 1.0 / max(along, max(nearest, 1e-9))
    r0 = (gain[0, 0] * s0 + gain[0, 1] * s1 + gain[0, 2] * y2) * inverse
    r1 = (gain[1, 0] * s0 + gain[1, 1] * s1 + gain[1, 2] * y2) * inverse
    e0, e1 = r0 + shift[0], r1 + shift[1]
    square = e0 * e0 + e1 * e1
    cost, root = square, 1.0
    if kind == 1 and square > bend * bend:
        length = math.sqrt(square)
        cost, root = 2.0 * bend * length - bend * bend, math.sqrt(bend / length)
    elif kind == 2:
        over = 1.0 + square / (bend * bend)
        cost, root = bend * bend * math.log(over), math.sqrt(1.0 / over)
    r[0], r[1], r[8] = e0 * root, e1 * root, root
    for i in range(2):
        back = 0.0
        if angular:
            back = r0 if i == 0 else r1
        scale = inverse * root
        g0 = (gain[i, 0] - back * ray[0]) * scale * stretch
        g1 = (gain[i, 1] - back * ray[1]) * scale * stretch
        g2 = (gain[i, 2] - back * ray[2]) * scale
        j0 = g0 * turned[0, 0] + g1 * turned[1, 0] + g2 * turned[2, 0]
        j1 = g0 * turned[0, 1] + g1 * turned[1, 1] + g2 * turned[2, 1]
        j2 = g0 * turned[0, 2] + g1 * turned[1, 2] + g2 * turned[2, 2]
        c0, c1, c2 = y1 * g2 - y2 * g1, y2 * g0 - y0 * g2, y0 * g1 - y1 * g0
        Jx[i, 0], Jx[i, 1], Jx[i, 2] = j0, j1, j2
        Q[i, 0] = c0 * left[0, 0] + c1 * left[1, 0] + c2 * left[2, 0]
        Q[i, 1] = c0 * left[0, 1] + c1 * left[1, 1] + c2 * left[2, 1]
        Q[i, 2] = c0 * left[0, 2] + c1 * left[1, 2] + c2 * left[2, 2]
        Q[i, 3], Q[i, 4], Q[i, 5] = -j0, -j1, -j2
        Q[i, 6] = (g0 * y0 + g1 * y1) * growth
        Q[i, 7] = j0 * v0 + j1 * v1 + j2 * v2
        Q[i, 8] = c0
        r[2 + 3 * i], r[3 + 3 * i], r[4 + 3 * i] = c0, c1, c2
    return 0.5 * cost


@inlined
def _pose_time(Q, Jx, r, spin, velocity):  # type: ignore[no-untyped-def]
    """Fills the ninth column of Q: what a second of log time does through the camera's own motion."""
    for i in range(2):
        turn = r[2 + 3 * i] * spin[0] + r[3 + 3 * i] * spin[1] + r[4 + 3 * i] * spin[2]
        Q[i, 8] = turn - Jx[i, 0] * velocity[3] - Jx[i, 1] * velocity[4] - Jx[i, 2] * velocity[5]


@inlined
def _spin(turned, measured, rate, spin):  # type: ignore[no-untyped-def]
    """The measured pose's turning rate in the axes of the corrected camera: exp(w) rate, exp(w) = turned measured'."""
    b0 = measured[0, 0] * rate[0] + measured[1, 0] * rate[1] + measured[2, 0] * rate[2]
    b1 = measured[0, 1] * rate[0] + measured[1, 1] * rate[1] + measured[2, 1] * rate[2]
    b2 = measured[0, 2] * rate[0] + measured[1, 2] * rate[1] + measured[2, 2] * rate[2]
    for i in range(3):
        spin[i] = turned[i, 0] * b0 + turned[i, 1] * b1 + turned[i, 2] * b2


@compiled
def _turns(error, measured, turned, left, work):  # type: ignore[no-untyped-def]
    """`_turn` of all lanes: error (6, w); measured, turned and left (9, w); work (13, w)."""
    x, y, z, square, s, a, b, e = error[0], error[1], error[2], work[9], work[10], work[11], work[12], work
    width, largest = len(square), 0.0
    for i in range(width):
        square[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]
        largest = max(largest, square[i])
    for i in range(width):
        q = square[i]
        s[i] = 1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q / 362880)))
    for i in range(width):
        q = square[i]
        a[i] = 0.5 + q * (-1 / 24 + q * (1 / 720 + q * (-1 / 40320 + q / 3628800)))
    for i in range(width):
        q = square[i]
        b[i] = 1 / 6 + q * (-1 / 120 + q * (1 / 5040 + q * (-1 / 362880 + q / 39916800)))
    if largest >= 1e-2:
        for i in range(width):
            if square[i] >= 1e-2:
                angle = math.sqrt(square[i])
                s[i] = math.sin(angle) / angle
                a[i] = (1.0 - math.cos(angle)) / square[i]
                b[i] = (1.0 - s[i]) / square[i]
    for i in range(width):
        e[0, i] = 1.0 - a[i] * (y[i] * y[i] + z[i] * z[i])
    for i in range(width):
        e[4, i] = 1.0 - a[i] * (x[i] * x[i] + z[i] * z[i])
    for i in range(width):
        e[8, i] = 1.0 - a[i] * (x[i] * x[i] + y[i] * y[i])
    for i in range(width):
        e[1, i] = a[i] * x[i] * y[i] - s[i] * z[i]
    for i in range(width):
        e[3, i] = a[i] * x[i] * y[i] + s[i] * z[i]
    for i in range(width):
        e[2, i] = a[i] * x[i] * z[i] + s[i] * y[i]
    for i in range(width):
        e[6, i] = a[i] * x[i] * z[i] - s[i] * y[i]
    for i in range(width):
        e[5, i] = a[i] * y[i] * z[i] - s[i] * x[i]
    for i in range(width):
        e[7, i] = a[i] * y[i] * z[i] + s[i] * x[i]
    for row in range(3):
        for column in range(3):
            for i in range(width):
                turned[3 * row + column, i] = (
                    e[3 * row, i] * measured[column, i]
                    + e[3 * row + 1, i] * measured[3 + column, i]
                    + e[3 * row + 2, i] * measured[6 + column, i]
                )
    for i in range(width):
        left[0, i] = 1.0 - b[i] * (y[i] * y[i] + z[i] * z[i])
    for i in range(width):
        left[4, i] = 1.0 - b[i] * (x[i] * x[i] + z[i] * z[i])
    for i in range(width):
        left[8, i] = 1.0 - b[i] * (x[i] * x[i] + y[i] * y[i])
    for i in range(width):
        left[1, i] = b[i] * x[i] * y[i] - a[i] * z[i]
    for i in range(width):
        left[3, i] = b[i] * x[i] * y[i] + a[i] * z[i]
    for i in range(width):
        left[2, i] = b[i] * x[i] * z[i] + a[i] * y[i]
    for i in range(width):
        left[6, i] = b[i] * x[i] * z[i] - a[i] * y[i]
    for i in range(width):
        left[5, i] = b[i] * y[i] * z[i] - a[i] * x[i]
    for i in range(width):
        left[7, i] = b[i] * y[i] * z[i] + a[i] * x[i]


@compiled
def _spins(turned, measured, rate, work, spin):  # type: ignore[no-untyped-def]
    """`_spin` of all lanes: rate (6, w), spin (3, w), work (3, w)."""
    for j in range(3):
        for i in range(len(spin[0])):
            work[j, i] = measured[j, i] * rate[0, i] + measured[3 + j, i] * rate[1, i] + measured[6 + j, i] * rate[2, i]
    for j in range(3):
        for i in range(len(spin[0])):
            spin[j, i] = (
                turned[3 * j, i] * work[0, i] + turned[3 * j + 1, i] * work[1, i] + turned[3 * j + 2, i] * work[2, i]
            )


@compiled
def _robust(square, kind, bend, root):  # type: ignore[no-untyped-def]
    """The root (w,) of the robust weights of squared lengths; returns half of rho, summed."""
    cost = 0.0
    if kind == 1:
        for i in range(len(root)):
            length = math.sqrt(max(square[i], bend * bend))
            root[i] = math.sqrt(bend / length)
            outside = square[i] > bend * bend
            cost += 0.5 * (2.0 * bend * length - bend * bend if outside else square[i])
    elif kind == 2:
        for i in range(len(root)):
            over = 1.0 + square[i] / (bend * bend)
            root[i] = math.sqrt(1.0 / over)
            cost += 0.5 * bend * bend * math.log(over)
    else:
        for i in range(len(root)):
            root[i] = 1.0
            cost += 0.5 * square[i]
    return cost


@compiled
def _sights(  # type: ignore[no-untyped-def]
    series, u, turned, left, place, lensed, growth, gain, ray, shift, angular, kind, bend, has_rate, spin, rate, JQ, R,
    root, work,
):  # fmt: skip
    """`_sight` and `_pose_time` of one target in all lanes: JQ (2, 8, w), R (2, w), root (w,); returns half of rho.

    series (3, K + 1), place (3, w), gain (6, w), ray (3, w), shift (2, w), spin (3, w), rate (6, w), work (16, w). The
    focal scale is in gain and ray; `lensed` says that growth (w,) is not one everywhere. An unseen target has gain and
    shift zero.
    """
    width, top = len(u), series.shape[1] - 1
    away, y, inverse, square, c = work[:3], work[3:6], work[6], work[7], work[8:14]
    for i in range(3):
        for w in range(width):
            away[i, w] = series[i, top]
        for k in range(top - 1, -1, -1):
            for w in range(width):
                away[i, w] = away[i, w] * u[w] + series[i, k]
        for w in range(width):
            away[i, w] -= place[i, w]
    for i in range(3):
        for w in range(width):
            y[i, w] = (
                turned[3 * i, w] * away[0, w] + turned[3 * i + 1, w] * away[1, w] + turned[3 * i + 2, w] * away[2, w]
            )
    if angular:
        for w in range(width):
            along = ray[0, w] * y[0, w] + ray[1, w] * y[1, w] + ray[2, w] * y[2, w]
            length = math.sqrt(y[0, w] * y[0, w] + y[1, w] * y[1, w] + y[2, w] * y[2, w])
            inverse[w] = 1.0 / max(along, max(NEAREST_COSINE * length, 1e-9))
    else:
        for w in range(width):
            inverse[w] = 1.0
    back = work[14:16]
    for i in range(2):
        for w in range(width):
            back[i, w] = (
                gain[3 * i, w] * y[0, w] + gain[3 * i + 1, w] * y[1, w] + gain[3 * i + 2, w] * y[2, w]
            ) * inverse[w]
        for w in range(width):
            R[i, w] = back[i, w] + shift[i, w]
    for w in range(width):
        square[w] = R[0, w] * R[0, w] + R[1, w] * R[1, w]
    cost = _robust(square, kind, bend, root)
    for w in range(width):
        inverse[w] *= root[w]
    for i in range(2):
        for w in range(width):
            R[i, w] *= root[w]
        g, J = c[3:], JQ[i]
        for k in range(3):
            if angular:
                for w in range(width):
                    g[k, w] = (gain[3 * i + k, w] - back[i, w] * ray[k, w]) * inverse[w]
            else:
                for w in range(width):
                    g[k, w] = gain[3 * i + k, w] * inverse[w]
        for k in range(3):
            for w in range(width):
                J[3 + k, w] = -(g[0, w] * turned[k, w] + g[1, w] * turned[3 + k, w] + g[2, w] * turned[6 + k, w])
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            for w in range(width):
                c[k, w] = y[p, w] * g[q, w] - y[q, w] * g[p, w]
        for k in range(3):
            for w in range(width):
                J[k, w] = c[0, w] * left[k, w] + c[1, w] * left[3 + k, w] + c[2, w] * left[6 + k, w]
        for w in range(width):
            J[6, w] = g[0, w] * y[0, w] + g[1, w] * y[1, w]
        if lensed:
            for w in range(width):
                J[6, w] *= growth[w]
        if has_rate:
            for w in range(width):
                J[7, w] = c[0, w] * spin[0, w] + c[1, w] * spin[1, w] + c[2, w] * spin[2, w]
            for k in range(3):
                for w in range(width):
                    J[7, w] += J[3 + k, w] * rate[3 + k, w]
    return cost


@compiled
def _negative_sums(out, rows):  # type: ignore[no-untyped-def]
    """out (w,) = minus the sum of `rows` (n, w)."""
    for lane in range(len(out)):
        out[lane] = -rows[0, lane]
    for n in range(1, len(rows)):
        for lane in range(len(out)):
            out[lane] -= rows[n, lane]


@compiled
def _moments(m, pw, count, moment):  # type: ignore[no-untyped-def]
    """moment[k] = sum of m u^k for k < `count`: one, or up to three or five at once."""
    if count == 1:
        s0 = 0.0
        for lane in range(len(m)):
            s0 += m[lane]
        moment[0] = s0
        return
    if count <= 3:
        s0 = s1 = s2 = 0.0
        for lane in range(len(m)):
            v = m[lane]
            s0 += v
            s1 += v * pw[1, lane]
            s2 += v * pw[2, lane]
        moment[0], moment[1], moment[2] = s0, s1, s2
        return
    s0 = s1 = s2 = s3 = s4 = 0.0
    for lane in range(len(m)):
        v = m[lane]
        s0 += v
        s1 += v * pw[1, lane]
        s2 += v * pw[2, lane]
        s3 += v * pw[3, lane]
        s4 += v * pw[4, lane]
    moment[0], moment[1], moment[2], moment[3], moment[4] = s0, s1, s2, s3, s4
    for k in range(5, count):
        s0 = 0.0
        for lane in range(len(m)):
            s0 += m[lane] * pw[k, lane]
        moment[k] = s0


@inlined
def _columns(n_targets, powers, has_rate, placed, place, wide):  # type: ignore[no-untyped-def]
    """Where each column of z begins among a block's local unknowns, and how many powers of u it has there.

    The columns are what the others are made of: targets 3 N, rotation 3, focal, pose time where there is any, place
    errors 2 N where there are any. Position and time follow from the targets' columns, see `_spread_out`.
    """
    nx = 3 * n_targets
    first_q = nx * powers
    for z in range(nx):
        place[z], wide[z] = z * powers, powers
    for i in range(3):
        place[nx + i], wide[nx + i] = first_q + i, 1
    place[nx + 3], wide[nx + 3] = first_q + 6, 1
    z = nx + 4
    if has_rate:
        place[z], wide[z] = first_q + 9, 2
        z += 1
    if placed:
        for i in range(2 * n_targets):
            place[z + i], wide[z + i] = first_q + 11 + 2 * i, 2


@inlined
def _spread_out(N, g, series, per_s, n_targets, powers):  # type: ignore[no-untyped-def]
    """Fills in place the rows and columns of a camera's position and of time, from those of the targets.

    To move a camera is to move all targets the other way; to move time is to move them along their motion:
    dX/dt = sum_k k m_k u^(k - 1) / half_s, so every such column is a sum of the targets' own columns.
    """
    first_q = 3 * n_targets * powers
    size = len(g)
    for d in range(5):
        at = first_q + 3 + d if d < 3 else first_q + 4 + d
        for n in range(n_targets):
            for i in range(3):
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
            for i in range(3):
                row = (3 * n + i) * powers
                if d < 3:
                    if i == d:
                        own -= N[row, at]
                    continue
                for k in range(1, powers):
                    own += per_s * k * series[n, i, k] * N[row + k - 1 + d - 3, at]
        N[at, at] = own


@compiled
def lanes_of(begin):  # type: ignore[no-untyped-def]
    """How many frames are done at once where blocks begin at `begin` (B + 1,)."""
    longest = 1
    for b in range(len(begin) - 1):
        longest = max(longest, begin[b + 1] - begin[b])
    return min(LANES, 4 * ((longest + 3) // 4))


@inlined
def _first_kept(n_targets, has_rate, placed):  # type: ignore[no-untyped-def]
    """How many derivatives of residuals are kept, before L^-1 h and L."""
    return 2 * n_targets * (8 if has_rate else 7) + (n_targets if placed else 0)


@compiled
def kept_shape(begin, n_targets, has_rate, placed):  # type: ignore[no-untyped-def]
    """Shape of what `block_normals` keeps: chunks, rows, lanes."""
    width, chunks = lanes_of(begin), 0
    for b in range(len(begin) - 1):
        chunks += (begin[b + 1] - begin[b] + width - 1) // width
    return chunks, _first_kept(n_targets, has_rate, placed) + 27, width


@compiled
def room(chunks, rows, lanes):  # type: ignore[no-untyped-def]
    """Memory as the system gives it."""
    return np.empty((chunks, rows, lanes))


@compiled
def block_normals(  # type: ignore[no-untyped-def]
    cam_from_enu, position, rate, has_rate, ray, gain, lens, seen, angular, spread, prior, damping, kind, bend,
    series, bias, focal, own, shift, place_gain, begin, camera, time_u, half_s, keep, kept,
):  # fmt: skip
    """Twin of `elimination.block_normals_plain`: normal (B, L, L), gradient (B, L), cost, frame gain.

    shift (F, N, 2) and place_gain (F, N) of place errors; without frames where there are none.
    With `keep` also what `kept_steps` needs of every frame, into `kept` of `kept_shape`: the residuals' derivatives
    by its pose, focal length and log time, and by place errors; L^-1 h, the inverse of the diagonal of L, the factor of
    H, and L below it.
    """
    n_blocks, n_targets, powers = len(camera), seen.shape[1], series.shape[3]
    placed = len(shift) > 0
    nx = 3 * n_targets
    nq = 8 if has_rate else 7
    first_place = nx + nq - 3
    nz = first_place + (2 * n_targets if placed else 0)
    nk = max(2 * powers - 1, 5)
    size = nx * powers + 11 + (4 * n_targets if placed else 0)
    column, wide = np.zeros(nz, np.int64), np.zeros(nz, np.int64)
    _columns(n_targets, powers, has_rate, placed, column, wide)
    width = lanes_of(begin)
    normal = np.zeros((n_blocks, size, size))
    gradient = np.zeros((n_blocks, size))
    rows, first_kept = 2 * n_targets, _first_kept(n_targets, has_rate, placed)
    R, DX, DQ = np.empty((rows, width)), np.empty((nx, 8, width)), np.empty((8, 8, width))
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
        for i in range(6):
            still = still and spread[c, i] == 0.0
        whole = math.exp(focal[c])
        per_s = 1.0 / half_s[b]
        N, g = normal[b], gradient[b]
        for low in range(begin[b], begin[b + 1], width):
            lanes = min(width, begin[b + 1] - low)
            chunk += 1
            store = kept[chunk] if keep else own_store
            JQ, PG = store[: rows * nq].reshape(rows, nq, width), store[rows * nq :]
            wh, inverse = store[first_kept:], store[first_kept + 6 :]
            # --- linearise; lanes without a frame have no gain
            if lanes < width:
                gain_at[:, :, lanes:] = 0.0
                shift_at[:, :, lanes:] = 0.0
                worth[:, lanes:] = 0.0
                pw[:, lanes:] = 0.0
                mine[:, lanes:] = 0.0
            for lane in range(lanes):
                f = low + lane
                pw[0, lane], pw[1, lane] = 1.0, time_u[f]
                for i in range(6):
                    mine[i, lane] = own[f, i]
                for i in range(3):
                    place[i, lane] = position[f, i]
                    for j in range(3):
                        measured[3 * i + j, lane] = cam_from_enu[f, i, j]
                if has_rate:
                    for i in range(6):
                        rate_at[i, lane] = rate[f, i]
                for n in range(n_targets):
                    stretch, growth_at[n, lane] = _stretch(lens, f, n, focal[c], whole)
                    for i in range(3):
                        k = stretch if i < 2 else 1.0
                        ray_at[n, i, lane] = k * ray[f, n, i]
                        gain_at[n, i, lane] = k * gain[f, n, 0, i]
                        gain_at[n, 3 + i, lane] = k * gain[f, n, 1, i]
                if placed:
                    for n in range(n_targets):
                        shift_at[n, 0, lane], shift_at[n, 1, lane] = shift[f, n, 0], shift[f, n, 1]
                        worth[n, lane] = place_gain[f, n]
            for k in range(2, nk):
                for lane in range(width):
                    pw[k, lane] = pw[k - 1, lane] * pw[1, lane]
            for i in range(6):
                for lane in range(width):
                    error[i, lane] = bias[c, i] + spread[c, i] * mine[i, lane]
                squares = 0.0
                for lane in range(width):
                    squares += mine[i, lane] * mine[i, lane]
                cost += 0.5 * prior[c, i] * squares
            for i in range(3):
                for lane in range(width):
                    place[i, lane] += error[3 + i, lane]
            _turns(error, measured, turned, left, work)
            if has_rate:
                _spins(turned, measured, rate_at, work, spin)
            for n in range(n_targets):
                cost += _sights(
                    series[b, n], pw[1], turned, left, place, lensed, growth_at[n], gain_at[n], ray_at[n], shift_at[n],
                    angular, kind, bend, has_rate, spin, rate_at, JQ[2 * n : 2 * n + 2], R[2 * n : 2 * n + 2], root,
                    work,
                )  # fmt: skip
                if placed:
                    for lane in range(width):
                        PG[n, lane] = worth[n, lane] * root[lane]
            # --- their products, all lanes at once; the derivative by a target's place is minus that by the camera's
            for n in range(n_targets):
                x = 2 * n
                for i in range(3):
                    z = 3 * n + i
                    for lane in range(width):
                        gz[z, lane] = -(JQ[x, 3 + i, lane] * R[x, lane] + JQ[x + 1, 3 + i, lane] * R[x + 1, lane])
                    for j in range(nq):
                        if j < 3 or j > 5 or j - 3 <= i:
                            for lane in range(width):
                                DX[z, j, lane] = -(
                                    JQ[x, 3 + i, lane] * JQ[x, j, lane] + JQ[x + 1, 3 + i, lane] * JQ[x + 1, j, lane]
                                )
                    for j in range(i):
                        for lane in range(width):
                            DX[3 * n + j, 3 + i, lane] = DX[z, 3 + j, lane]
            for i in range(nq):
                if 3 <= i < 6:
                    _negative_sums(hq[i], gz[i - 3 : nx : 3])
                    for j in range(i + 1):
                        _negative_sums(DQ[i, j], DX[i - 3 :: 3, j])
                    continue
                z = nx + (i if i < 3 else i - 3)
                for lane in range(width):
                    gz[z, lane] = JQ[0, i, lane] * R[0, lane]
                for row in range(1, 2 * n_targets):
                    for lane in range(width):
                        gz[z, lane] += JQ[row, i, lane] * R[row, lane]
                if i < 3:
                    for lane in range(width):
                        hq[i, lane] = gz[z, lane]
                for j in range(i + 1):
                    if 3 <= j < 6:
                        _negative_sums(DQ[i, j], DX[j - 3 :: 3, i])
                        continue
                    for lane in range(width):
                        DQ[i, j, lane] = JQ[0, i, lane] * JQ[0, j, lane]
                    for row in range(1, 2 * n_targets):
                        for lane in range(width):
                            DQ[i, j, lane] += JQ[row, i, lane] * JQ[row, j, lane]
            for z in range(first_place, nz):
                row = z - first_place
                for lane in range(width):
                    gz[z, lane] = PG[row // 2, lane] * R[row, lane]
            # --- eliminate the frames' own errors
            if still:
                inverse[0] = 0.0
            if not still:
                for i in range(6):
                    si = spread[c, i]
                    for j in range(i + 1):
                        sij = si * spread[c, j]
                        for lane in range(width):
                            H[i, j, lane] = DQ[i, j, lane] * sij
                    for lane in range(width):
                        own_part = H[i, i, lane] * (1.0 + damping) + prior[c, i]
                        H[i, i, lane] = own_part if own_part > 0.0 else 1.0
                        wh[i, lane] = hq[i, lane] * si + prior[c, i] * mine[i, lane]
                for i in range(6):
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
                for i in range(6):
                    for k in range(i):
                        for lane in range(width):
                            wh[i, lane] -= H[i, k, lane] * wh[k, lane]
                    for lane in range(width):
                        wh[i, lane] *= inverse[i, lane]
                        frame_gain += 0.5 * wh[i, lane] * wh[i, lane]
                for z in range(nz):
                    for i in range(6):
                        si = spread[c, i]
                        if z < nx:
                            for lane in range(width):
                                W[z, i, lane] = DX[z, i, lane] * si
                        elif z >= first_place:
                            row = z - first_place
                            for lane in range(width):
                                W[z, i, lane] = PG[row // 2, lane] * JQ[row, i, lane] * si
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
                    for i in range(6):
                        for lane in range(width):
                            gz[z, lane] -= W[z, i, lane] * wh[i, lane]
                if keep:
                    for i in range(6):
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
                                    m[lane] = -PG[n, lane] * JQ[row, 3 + y % 3, lane]
                        elif y < first_place:
                            apart = False
                            p = y - nx if y - nx < 3 else y - nx + 3
                            for lane in range(width):
                                m[lane] = PG[n, lane] * JQ[row, p, lane]
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
                    _moments(m, pw, wide_z + wide_y - 1, moment)
                    for i in range(wide_z):
                        for j in range(wide_y):
                            N[at_z + i, at_y + j] += moment[i + j]
        for i in range(size):
            for j in range(i):
                N[j, i] = N[i, j]
        _spread_out(N, g, series[b], per_s, n_targets, powers)
    return normal, gradient, cost, frame_gain


@compiled
def kept_steps(  # type: ignore[no-untyped-def]
    kept, has_rate, placed, spread, begin, camera, time_u, half_s, series, step, own, out
):
    """`own` + du into `out`: du as `frame_steps`, from what `block_normals` kept: - L'^-1 (L^-1 h + L^-1 E dz)."""
    n_targets, powers = series.shape[1], series.shape[3]
    first_q, nq, at = 3 * n_targets * powers, 8 if has_rate else 7, _first_kept(n_targets, has_rate, placed)
    width = kept.shape[2]
    right, dx, s, u = np.empty((6, width)), np.empty((3, width)), np.empty(width), np.zeros(width)
    d = np.zeros(step.shape[1])
    chunk = -1
    for b in range(len(begin) - 1):
        given, per_s = step[b], 1.0 / half_s[b]
        d[:] = given
        for n in range(n_targets):
            for i in range(3):
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
                out[low : low + lanes] = own[low : low + lanes]
                continue
            for lane in range(lanes):
                u[lane] = time_u[low + lane]
            for i in range(6):
                for lane in range(width):
                    right[i, lane] = 0.0
            for n in range(n_targets):
                for i in range(3):
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
                    if has_rate:
                        for lane in range(width):
                            s[lane] += J[7, lane] * (d[first_q + 9] + u[lane] * d[first_q + 10])
                    if placed:
                        k = first_q + 11 + 2 * row
                        for lane in range(width):
                            s[lane] += store[2 * n_targets * nq + n, lane] * (d[k] + u[lane] * d[k + 1])
                    for i in range(6):
                        for lane in range(width):
                            right[i, lane] += J[i, lane] * s[lane]
            for i in range(6):
                si = spread[camera[b], i]
                for lane in range(width):
                    right[i, lane] *= si
                for k in range(i):
                    for lane in range(width):
                        right[i, lane] -= store[at + 12 + (i * (i - 1)) // 2 + k, lane] * right[k, lane]
                for lane in range(width):
                    right[i, lane] *= store[at + 6 + i, lane]
            for i in range(6):
                for lane in range(width):
                    right[i, lane] += store[at + i, lane]
            for i in range(5, -1, -1):
                for k in range(i + 1, 6):
                    for lane in range(width):
                        right[i, lane] -= store[at + 12 + (k * (k - 1)) // 2 + i, lane] * right[k, lane]
                for lane in range(width):
                    right[i, lane] *= store[at + 6 + i, lane]
            for lane in range(lanes):
                for i in range(6):
                    out[low + lane, i] = own[low + lane, i] - right[i, lane]


@compiled
def frame_steps(  # type: ignore[no-untyped-def]
    cam_from_enu, position, rate, has_rate, ray, gain, lens, seen, angular, spread, prior, damping, kind, bend,
    series, bias, focal, own, begin, camera, time_u, half_s, step,
):  # fmt: skip
    """Twin of `elimination.frame_steps_plain` without place errors: du (F, 6)."""
    n_blocks, n_targets, powers = len(camera), seen.shape[1], series.shape[3]
    first_q = 3 * n_targets * powers
    out = np.zeros((len(own), 6))
    H, right = np.zeros((6, 6)), np.zeros(6)
    Q, Jx, r = np.zeros((2, 9)), np.zeros((2, 3)), np.zeros(9)
    turned, left = np.zeros((3, 3)), np.zeros((3, 3))
    error, place, spin, dq, unmoved = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros(9), np.zeros(2)
    for b in range(n_blocks):
        c = camera[b]
        still = True
        for i in range(6):
            still = still and spread[c, i] == 0.0
        if still:
            continue
        whole = math.exp(focal[c])
        per_s = 1.0 / half_s[b]
        d = step[b]
        for f in range(begin[b], begin[b + 1]):
            u = time_u[f]
            for i in range(6):
                error[i] = bias[c, i] + spread[c, i] * own[f, i]
                right[i] = 0.0
                for j in range(6):
                    H[i, j] = 0.0
            for i in range(3):
                place[i] = position[f, i] + error[3 + i]
            _turn(error, cam_from_enu[f], turned, left)
            if has_rate:
                _spin(turned, cam_from_enu[f], rate[f], spin)
            for i in range(7):
                dq[i] = d[first_q + i]
            dq[7] = d[first_q + 7] + u * d[first_q + 8]
            dq[8] = d[first_q + 9] + u * d[first_q + 10]
            for n in range(n_targets):
                if not seen[f, n]:
                    continue
                stretch, growth = _stretch(lens, f, n, focal[c], whole)
                _sight(
                    series[b], n, u, per_s, turned, left, place, stretch, growth, gain[f, n], ray[f, n], unmoved,
                    angular, kind, bend, Q, Jx, r,
                )  # fmt: skip
                if has_rate:
                    _pose_time(Q, Jx, r, spin, rate[f])
                else:
                    Q[0, 8] = Q[1, 8] = 0.0
                a0, a1 = r[0], r[1]
                for i in range(3):
                    at = (3 * n + i) * powers
                    moved = d[at + powers - 1]
                    for k in range(powers - 2, -1, -1):
                        moved = moved * u + d[at + k]
                    a0 += Jx[0, i] * moved
                    a1 += Jx[1, i] * moved
                for i in range(9):
                    a0 += Q[0, i] * dq[i]
                    a1 += Q[1, i] * dq[i]
                for i in range(6):
                    right[i] += Q[0, i] * a0 + Q[1, i] * a1
                    for j in range(i + 1):
                        H[i, j] += Q[0, i] * Q[0, j] + Q[1, i] * Q[1, j]
            for i in range(6):
                right[i] = right[i] * spread[c, i] + prior[c, i] * own[f, i]
                for j in range(i + 1):
                    H[i, j] *= spread[c, i] * spread[c, j]
                H[i, i] = H[i, i] * (1.0 + damping) + prior[c, i]
                if H[i, i] <= 0.0:
                    H[i, i] = 1.0
            for i in range(6):
                for j in range(i):
                    for k in range(j):
                        H[i, j] -= H[i, k] * H[j, k]
                    H[i, j] *= H[j, j]
                for k in range(i):
                    H[i, i] -= H[i, k] * H[i, k]
                H[i, i] = 1.0 / math.sqrt(H[i, i])
                for k in range(i):
                    right[i] -= H[i, k] * right[k]
                right[i] *= H[i, i]
            for i in range(5, -1, -1):
                for k in range(i + 1, 6):
                    right[i] -= H[k, i] * right[k]
                right[i] *= H[i, i]
                out[f, i] = -right[i]
    return out


@compiled
def assemble(  # type: ignore[no-untyped-def]
    normal, gradient, transform, degree, span, local_from_camera, places, n_band, n_border, width
):
    """Twin of `assembly.assemble_plain`: band (w + 1, n), border (n, q), corner (q, q), gradient (n + q,).

    `transform` (S, N, K + 1, K + 1) holds every target's own columns first, `degree` (N,) says how many are its.
    """
    n_blocks, size = gradient.shape
    n_targets, powers = transform.shape[1], transform.shape[2]
    first_q = 3 * n_targets * powers
    wide = places.shape[1]
    parameters = local_from_camera.shape[2]
    first_p = wide - parameters
    band, border = np.zeros((width + 1, n_band)), np.zeros((n_band, n_border))
    corner, right = np.zeros((n_border, n_border)), np.zeros(n_band + n_border)
    half, vector = np.zeros((wide, size)), np.zeros(wide)
    for b in range(n_blocks):
        N, g, place, q_from_p = normal[b], gradient[b], places[b], local_from_camera[b]
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


def warm() -> None:
    """Compiles, or loads from the cache, everything above: the clock of a solve shall not count it."""
    if not AVAILABLE or warm.done:  # type: ignore[attr-defined]
        return
    i, f, eye = np.zeros(1, np.int64), np.zeros, np.eye(3)[None]
    begin, seen = np.array([0, 1]), np.ones((1, 1), dtype=bool)
    ray, gain = np.array([[[0.0, 0.0, 1.0]]]), np.zeros((1, 1, 2, 3))
    given = (
        eye, f((1, 3)), f((1, 6)), False, ray, gain, f((0, 1, 2)), seen, True, f((1, 6)), np.ones((1, 6)), 0.0, 0, 1.0,
        f((1, 1, 3, 1)), f((1, 6)), f(1), f((1, 6)),
    )  # fmt: skip
    where, kept = (begin, i, f(1), np.ones(1)), room(*kept_shape(begin, 1, False, False))
    normal, gradient, _, _ = block_normals(*given, f((0, 1, 2)), f((0, 1)), *where, True, kept)
    frame_steps(*given, *where, gradient)
    kept_steps(kept, False, False, f((1, 6)), *where, f((1, 1, 3, 1)), gradient, f((1, 6)), f((1, 6)))
    places = np.full((1, 15), -1)
    assemble(normal, gradient, np.ones((1, 1, 1, 1)), i, i, f((1, 11, 12)), places, 0, 0, 0)
    warm.done = True  # type: ignore[attr-defined]


warm.done = False  # type: ignore[attr-defined]
