"""Many frames side by side: rotations, residuals with their derivatives, and moments, for `_kernels`.

The innermost loop always runs over lanes, frames that lie side by side in memory, and writes one row, which the
compiler turns into vector instructions. `axes` is 3, handed in because a number that the compiler knows makes it write
every loop out, which takes it ten times as long and gains nothing.
"""

# The arithmetic is spelt out in scalars: that is what makes it fast.
from __future__ import annotations

import math

from calibration.foundation.arrays import Floats
from calibration.foundation.compiled import compiled

NEAREST_COSINE = 0.05


@compiled
def turn(w: Floats, measured: Floats, out: Floats) -> None:
    """exp(w) @ measured (3, 3) into `out`; w (3,) or longer."""
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    if square < 1e-2:
        s = 1.0 + square * (-1 / 6 + square * (1 / 120 + square * (-1 / 5040 + square / 362880)))
        a = 0.5 + square * (-1 / 24 + square * (1 / 720 + square * (-1 / 40320 + square / 3628800)))
    else:
        angle = math.sqrt(square)
        s, a = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    for j in range(out.shape[1]):
        x, y, z = measured[0, j], measured[1, j], measured[2, j]
        along = a * (w[0] * x + w[1] * y + w[2] * z)
        keep = 1.0 - a * square
        out[0, j] = keep * x + s * (w[1] * z - w[2] * y) + along * w[0]
        out[1, j] = keep * y + s * (w[2] * x - w[0] * z) + along * w[1]
        out[2, j] = keep * z + s * (w[0] * y - w[1] * x) + along * w[2]


@compiled
def turns(error: Floats, measured: Floats, turned: Floats, left: Floats, work: Floats, axes: int) -> None:
    """exp(w) @ measured into `turned` (9, w), the left Jacobian of w into `left` (9, w); error (6, w), work (13, w)."""
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
    for row in range(axes):
        for column in range(axes):
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
def spins(turned: Floats, measured: Floats, rate: Floats, work: Floats, spin: Floats, axes: int) -> None:
    """The measured pose's turning rate in the axes of the corrected camera, exp(w) rate: rate (6, w), spin (3, w)."""
    for j in range(axes):
        for i in range(len(spin[0])):
            work[j, i] = measured[j, i] * rate[0, i] + measured[3 + j, i] * rate[1, i] + measured[6 + j, i] * rate[2, i]
    for j in range(axes):
        for i in range(len(spin[0])):
            spin[j, i] = (
                turned[3 * j, i] * work[0, i] + turned[3 * j + 1, i] * work[1, i] + turned[3 * j + 2, i] * work[2, i]
            )


@compiled
def robust(square: Floats, kind: int, bend: float, root: Floats) -> float:
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
def sights(
    series: Floats, u: Floats, turned: Floats, left: Floats, position: Floats, lensed: bool, growth: Floats,
    gain: Floats, ray: Floats, shift: Floats, angular: bool, kind: int, bend: float, rated: bool, spin: Floats,
    rate: Floats, JQ: Floats, R: Floats, root: Floats, work: Floats, axes: int,
) -> float:  # fmt: skip
    """Residuals R (2, w) of one target, their derivatives JQ (2 n, w), root weights (w,); returns half of rho, summed.

    JQ is by rotation, position, log focal scale and, where `rated`, pose time: n = 7 or 8 rows for each residual.

    series (3, K + 1), position (3, w), gain (6, w), ray (3, w), shift (2, w), spin (3, w), rate (6, w), work (16, w).
    The focal scale is in gain and ray; `lensed` says that growth (w,) is not one everywhere. An unseen target has gain
    and shift zero.
    """
    width, top = len(u), series.shape[1] - 1
    away, y, inverse, square, c = work[:3], work[3:6], work[6], work[7], work[8:14]
    for i in range(axes):
        for w in range(width):
            away[i, w] = series[i, top]
        for k in range(top - 1, -1, -1):
            for w in range(width):
                away[i, w] = away[i, w] * u[w] + series[i, k]
        for w in range(width):
            away[i, w] -= position[i, w]
    for i in range(axes):
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
    cost: float = robust(square, kind, bend, root)
    for w in range(width):
        inverse[w] *= root[w]
    for i in range(2):
        for w in range(width):
            R[i, w] *= root[w]
        g, J = c[3:], JQ[i * (len(JQ) // 2) :]
        for k in range(axes):
            if angular:
                for w in range(width):
                    g[k, w] = (gain[3 * i + k, w] - back[i, w] * ray[k, w]) * inverse[w]
            else:
                for w in range(width):
                    g[k, w] = gain[3 * i + k, w] * inverse[w]
        for k in range(axes):
            for w in range(width):
                J[3 + k, w] = -(g[0, w] * turned[k, w] + g[1, w] * turned[3 + k, w] + g[2, w] * turned[6 + k, w])
        for k in range(axes):
            p, q = (k + 1) % 3, (k + 2) % 3
            for w in range(width):
                c[k, w] = y[p, w] * g[q, w] - y[q, w] * g[p, w]
        for k in range(axes):
            for w in range(width):
                J[k, w] = c[0, w] * left[k, w] + c[1, w] * left[3 + k, w] + c[2, w] * left[6 + k, w]
        for w in range(width):
            J[6, w] = g[0, w] * y[0, w] + g[1, w] * y[1, w]
        if lensed:
            for w in range(width):
                J[6, w] *= growth[w]
        if rated:
            for w in range(width):
                J[7, w] = c[0, w] * spin[0, w] + c[1, w] * spin[1, w] + c[2, w] * spin[2, w]
            for k in range(axes):
                for w in range(width):
                    J[7, w] += J[3 + k, w] * rate[3 + k, w]
    return cost


@compiled
def moments(m: Floats, pw: Floats, count: int, moment: Floats) -> None:
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
