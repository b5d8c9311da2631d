"""Compiled twin of the plain numpy alignment in `align`: bare arrays in, bare arrays out.

A test holds it equal to its twin; without numba `AVAILABLE` is false and the twin is used. Colours lie in planes and
pixels side by side, so that every sum is a vector instruction's; the interpreter is not held while it runs.
"""

from __future__ import annotations

import numpy as np

from calibration.foundation.compiled import AVAILABLE, compiled

__all__ = ["AVAILABLE", "judged", "settled"]


@compiled
def _sample(piece, linear, x0, y0, step, h, w, out):  # type: ignore[no-untyped-def]
    """The piece (H, W, 3) under a warp into `out` (3, h w), bilinear; edges repeat."""
    height, width = piece.shape[0], piece.shape[1]
    a, b, c, d = linear[0, 0] * step, linear[0, 1] * step, linear[1, 0] * step, linear[1, 1] * step
    left = x0 - a * (w - 1) / 2 - b * (h - 1) / 2
    top = y0 - c * (w - 1) / 2 - d * (h - 1) / 2
    v = 0
    for i in range(h):
        for j in range(w):
            x = min(max(left + a * j + b * i, 0.0), width - 1.0)
            y = min(max(top + c * j + d * i, 0.0), height - 1.0)
            ix, iy = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
            jx, jy = min(ix + 1, width - 1), min(iy + 1, height - 1)
            fx, fy = np.float32(x - ix), np.float32(y - iy)
            gx, gy = np.float32(1.0) - fx, np.float32(1.0) - fy
            for colour in range(3):
                above = piece[iy, ix, colour] * gx + piece[iy, jx, colour] * fx
                below = piece[jy, ix, colour] * gx + piece[jy, jx, colour] * fx
                out[colour, v] = above * gy + below * fy
            v += 1


@compiled
def _columns(pixels, step, out):  # type: ignore[no-untyped-def]
    """Translation (2), scale, rotation, shears (2) and gain of every value into `out` (7, 3, h w)."""
    h, w = pixels.shape[0], pixels.shape[1]
    half = np.float32(0.5 / step)
    mean = np.zeros(3, np.float32)
    for colour in range(3):
        total = 0.0
        for i in range(h):
            for j in range(w):
                total += pixels[i, j, colour]
        mean[colour] = total / (h * w)
    for i in range(h):
        up, down = max(i - 1, 0), min(i + 1, h - 1)
        uy = np.float32((i - (h - 1) / 2) * step)
        for j in range(w):
            before, after = max(j - 1, 0), min(j + 1, w - 1)
            ux = np.float32((j - (w - 1) / 2) * step)
            v = i * w + j
            for colour in range(3):
                gx = (pixels[i, after, colour] - pixels[i, before, colour]) * half
                gy = (pixels[down, j, colour] - pixels[up, j, colour]) * half
                out[0, colour, v], out[1, colour, v] = gx, gy
                out[2, colour, v], out[3, colour, v] = gx * ux + gy * uy, gy * ux - gx * uy
                out[4, colour, v], out[5, colour, v] = gx * ux - gy * uy, gx * uy + gy * ux
                out[6, colour, v] = pixels[i, j, colour] - mean[colour]


@compiled
def _inverse(columns, weight, prior):  # type: ignore[no-untyped-def]
    """Inverse (10, 10) of the normal matrix of the weighted columns (7, 3, n), brightness of each colour included."""
    n = weight.shape[0]
    normal = np.zeros((10, 10))
    for k in range(7):
        for colour in range(3):
            one = columns[k, colour]
            for m in range(k, 7):
                other = columns[m, colour]
                total = np.float32(0.0)
                for v in range(n):
                    total += weight[v] * one[v] * other[v]
                normal[k, m] += total
            total = np.float32(0.0)
            for v in range(n):
                total += weight[v] * one[v]
            normal[k, 7 + colour] = total
    every = 0.0
    for v in range(n):
        every += weight[v]
    for k in range(10):
        for m in range(k):
            normal[k, m] = normal[m, k]
    for k in range(7, 10):
        normal[k, k] = every
    for k in range(10):
        normal[k, k] += prior[k] + 1e-9
    return np.linalg.inv(normal)


@compiled
def _right_side(columns, weight, change, out):  # type: ignore[no-untyped-def]
    """Weighted columns times residuals (3, n) into `out` (10,)."""
    n = weight.shape[0]
    for k in range(7):
        total = np.float32(0.0)
        for colour in range(3):
            one, other = columns[k, colour], change[colour]
            for v in range(n):
                total += weight[v] * one[v] * other[v]
        out[k] = total
    for colour in range(3):
        total = np.float32(0.0)
        other = change[colour]
        for v in range(n):
            total += weight[v] * other[v]
        out[7 + colour] = total


@compiled
def _doubted(weight, columns, change, step, spread, robust_sigmas, out):  # type: ignore[no-untyped-def]
    """`weight` times the robust weight (Geman-McClure) of what `step` (10,) leaves over, into `out` (n,)."""
    n = weight.shape[0]
    s = step.astype(np.float32)
    total = np.zeros(n, np.float32)
    for colour in range(3):
        c = columns[:, colour]
        for v in range(n):
            r = change[colour, v] - s[7 + colour]
            r -= s[0] * c[0, v] + s[1] * c[1, v] + s[2] * c[2, v] + s[3] * c[3, v]
            r -= s[4] * c[4, v] + s[5] * c[5, v] + s[6] * c[6, v]
            total[v] += r * r
    share = np.float32(1.0 / (3.0 * robust_sigmas**2))
    for v in range(n):
        doubt = np.float32(1.0) + total[v] * share / spread[v]
        out[v] = weight[v] / (doubt * doubt)


@compiled
def _shape_offset(linear, predicted):  # type: ignore[no-untyped-def]
    """predicted^-1 linear - 1 as (scale, rotation, shear, shear)."""
    p, q, r, s = predicted[0, 0], predicted[0, 1], predicted[1, 0], predicted[1, 1]
    size = p * s - q * r
    d00 = (s * linear[0, 0] - q * linear[1, 0]) / size - 1.0
    d01 = (s * linear[0, 1] - q * linear[1, 1]) / size
    d10 = (p * linear[1, 0] - r * linear[0, 0]) / size
    d11 = (p * linear[1, 1] - r * linear[0, 1]) / size - 1.0
    return np.array([d00 + d11, d10 - d01, d00 - d11, d01 + d10]) / 2


@compiled
def _weights(spread, own, step, linear, centre, near, shared, image):  # type: ignore[no-untyped-def]
    """Information of each pixel (h w,): near the tracked point, of small spread, inside the image (width, height)."""
    h, w = spread.shape[0], spread.shape[1]
    weight = np.empty(h * w, np.float32)
    across = np.empty(w)
    for j in range(w):
        across[j] = np.exp(-0.5 * ((j - (w - 1) / 2) * step / near[0]) ** 2)
    for i in range(h):
        uy = (i - (h - 1) / 2) * step
        down = np.exp(-0.5 * (uy / near[1]) ** 2)
        for j in range(w):
            ux = (j - (w - 1) / 2) * step
            x = linear[0, 0] * ux + linear[0, 1] * uy + centre[0]
            y = linear[1, 0] * ux + linear[1, 1] * uy + centre[1]
            inside = x >= 0 and x <= image[0] - 1 and y >= 0 and y <= image[1] - 1
            weight[i * w + j] = across[j] * down * own[i, j] / (shared * spread[i, j]) if inside else 0.0
    return weight


@compiled
def settled(  # type: ignore[no-untyped-def]
    piece, corner, pixels, spreads, own, near, shared, image, step_px, linear, centre, predicted, prior, iterations,
    enough_px, robust_sigmas,
):  # fmt: skip
    """The descent: (linear, centre, inverse (10, 10), what is seen (3, n), robust weight (n,))."""
    h, w = pixels.shape[0], pixels.shape[1]
    n = h * w
    spread = spreads.reshape(n)
    weight = _weights(spreads, own, step_px, linear, centre, near, shared, image)
    columns = np.empty((7, 3, n), np.float32)
    _columns(pixels, step_px, columns)
    target, seen, change = np.empty((3, n), np.float32), np.empty((3, n), np.float32), np.empty((3, n), np.float32)
    for i in range(h):
        for j in range(w):
            for colour in range(3):
                target[colour, i * w + j] = pixels[i, j, colour]
    robust = weight.copy()
    inverse = _inverse(columns, robust, prior)
    right = np.empty(10)
    a, x, y = linear.copy(), centre[0], centre[1]
    _sample(piece, a, x - corner[0], y - corner[1], step_px, h, w, seen)
    for iteration in range(iterations):
        change[:] = seen - target
        _right_side(columns, robust, change, right)
        step = inverse @ right
        if iteration == 2:
            _doubted(weight, columns, change, step, spread, robust_sigmas, robust)
            inverse = _inverse(columns, robust, prior)
            _right_side(columns, robust, change, right)
            step = inverse @ right
        off = _shape_offset(a, predicted)
        for k in range(10):
            for m in range(4):
                step[k] += inverse[k, 2 + m] * prior[2 + m] * off[m]
        s, r, e, f = step[2], step[3], step[4], step[5]
        p, q, u, t = 1 + s + e, f - r, f + r, 1 + s - e
        size = p * t - q * u
        b00, b01 = (a[0, 0] * t - a[0, 1] * u) / size, (a[0, 1] * p - a[0, 0] * q) / size
        b10, b11 = (a[1, 0] * t - a[1, 1] * u) / size, (a[1, 1] * p - a[1, 0] * q) / size
        a[0, 0], a[0, 1], a[1, 0], a[1, 1] = b00, b01, b10, b11
        x -= b00 * step[0] + b01 * step[1]
        y -= b10 * step[0] + b11 * step[1]
        _sample(piece, a, x - corner[0], y - corner[1], step_px, h, w, seen)
        if iteration > 2 and step[0] ** 2 + step[1] ** 2 < enough_px**2:
            break
    return a, np.array([x, y]), inverse, seen, robust


@compiled
def judged(  # type: ignore[no-untyped-def]
    pixels, spread, trust, core, seen, robust, step, linear, centre, image, least_tolerance, most_tolerance,
    robust_sigmas, brighter,
):  # fmt: skip
    """(raw, light (h, w, 3), residual (h, w), share agreeing, correlation, share of the box inside the image)."""
    h, w = pixels.shape[0], pixels.shape[1]
    box, core = 0, core.copy()
    for i in range(h):
        uy = (i - (h - 1) / 2) * step
        for j in range(w):
            if core[i, j]:
                box += 1
                ux = (j - (w - 1) / 2) * step
                x = linear[0, 0] * ux + linear[0, 1] * uy + centre[0]
                y = linear[1, 0] * ux + linear[1, 1] * uy + centre[1]
                core[i, j] = x >= 0 and x <= image[0] - 1 and y >= 0 and y <= image[1] - 1
    raw, light, residual = np.empty_like(pixels), np.empty_like(pixels), np.empty((h, w), np.float32)
    total, mean_seen, mean_own = 0.0, np.zeros(3), np.zeros(3)
    core_total, core_seen, core_own, members = 0.0, np.zeros(3), np.zeros(3), 0
    for i in range(h):
        for j in range(w):
            v = i * w + j
            weight = robust[v]
            total += weight
            inside = core[i, j]
            if inside:
                members += 1
                core_total += trust[i, j]
            for colour in range(3):
                raw[i, j, colour] = seen[colour, v]
                mean_seen[colour] += weight * seen[colour, v]
                mean_own[colour] += weight * pixels[i, j, colour]
                if inside:
                    core_seen[colour] += trust[i, j] * seen[colour, v]
                    core_own[colour] += trust[i, j] * pixels[i, j, colour]
    total, core_total = max(total, 1e-12), max(core_total, 1e-12)
    mean_seen, mean_own = mean_seen / total, mean_own / total
    core_seen, core_own = core_seen / core_total, core_own / core_total
    common, square, ab, aa, bb = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(h):
        for j in range(w):
            weight = robust[i * w + j]
            for colour in range(3):
                s, o = raw[i, j, colour] - mean_seen[colour], pixels[i, j, colour] - mean_own[colour]
                common += weight * s * o
                square += weight * s * s
                if core[i, j]:
                    a, b = pixels[i, j, colour] - core_own[colour], raw[i, j, colour] - core_seen[colour]
                    ab += trust[i, j] * a * b
                    aa += trust[i, j] * a * a
                    bb += trust[i, j] * b * b
    for colour in range(3):
        mean_own[colour] = mean_seen[colour] - min(max(mean_seen[colour] - mean_own[colour], -brighter), brighter)
    gain = min(max(common / max(square, 1e-9), 0.7), 1.4)
    agreeing, sure = 0.0, 0.0
    for i in range(h):
        for j in range(w):
            off = 0.0
            for colour in range(3):
                light[i, j, colour] = (raw[i, j, colour] - mean_seen[colour]) * gain + mean_own[colour]
                off += (light[i, j, colour] - pixels[i, j, colour]) ** 2
            residual[i, j] = off / 3
            if core[i, j]:
                sure += trust[i, j]
                if residual[i, j] < robust_sigmas**2 * min(max(spread[i, j], least_tolerance), most_tolerance):
                    agreeing += trust[i, j]
    norm = np.sqrt(aa * bb)
    score = -1.0 if members < 4 else (ab / norm if norm > 1e-6 else 0.0)
    return raw, light, residual, agreeing / max(1e-9, sure), score, members / max(1, box)
