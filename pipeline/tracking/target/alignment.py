"""Sub-pixel alignment: inverse-compositional Lucas-Kanade on colour, with a prior on shape.

With r(u) = I(A u + t) - T(u), the step (B, d) minimises

    sum_u w0(u) w(u) |r(u) - grad T (B u + d) - g T~(u) - b|^2 / (spread(u) c)  +  |D - B|^2 in the prior's metric

where w0 falls off around the tracked point (a vehicle is no plane: seen from elsewhere, its far parts shift against
the surface under the point), w is robust (what is covered or does not belong to the target loses its say), g and b are
a gain and a brightness for each colour, c the number of neighbouring pixels that share their noise, and D how far the
linear part is from its prediction: (scale, rotation, two shears). Then A <- A (1 + B)^-1, t <- t - A d. The gradient is
the template's, so the step's matrix is made twice, not in every iteration. The covariance of t is that of the last
step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.target import _kernels
from pipeline.tracking.target.template import Patch, Pixels, Template, Warp
from pipeline.tracking.video.frames import Image

ITERATIONS, ENOUGH_PX = 10, 0.004
SHARED_NOISE = 8.0  # pixels that one independent value of the noise covers, after smoothing and compression
ROBUST = 2.5  # sigmas at which a pixel has lost half its say
REACH_PX = 5.0
TOLERANCE = 4.0**2, 15.0**2  # least and largest squared residual (grey levels) that a pixel may be forgiven, one sigma
NEAR, LEAST_NEAR_PX = 0.22, 2.5  # one sigma of the weight around the tracked point: share of the box, at least
# scale, rotation, shears: what one frame may change
SHAPE_SIGMA = np.array([0.01, 0.02, 0.007, 0.007])
BRIGHTER = 12.0  # grey levels by which a target may be brighter or darker than its template, at most
GAIN_SIGMA, BRIGHTNESS_SIGMA = 0.1, 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Where a template was found.

    covariance_px2  (2, 2) of the centre
    score           weighted correlation over the box and the colours, -1 to 1
    agreeing        share of the box's pixels whose residual is as expected, 0 to 1
    inside          share of the box inside the image
    raw, seen       (h, w, 3) the image under the warp, and the same at the template's brightness
    residual        (h, w) squared, mean over the colours
    """

    warp: Warp
    covariance_px2: Floats
    score: float
    agreeing: float
    inside: float
    raw: Pixels
    seen: Pixels
    residual: Pixels


def align(image: Image, template: Template, start: Warp, predicted_linear: Floats, looseness: float = 1.0) -> Alignment:
    """Finds the template in an image from a start within about a quarter of its size.

    predicted_linear  (2, 2) the shape the prior expects
    looseness         factor on the prior's sigmas, for a target not seen for a while
    """
    patch = Patch.cut(image, start, template.shape, template.step_px, REACH_PX)
    way = aligned_compiled if _kernels.AVAILABLE else aligned_plain
    return way(image, template, patch, start, predicted_linear, looseness)


def aligned_compiled(
    image: Image, template: Template, patch: Patch, start: Warp, predicted_linear: Floats, looseness: float
) -> Alignment:
    """What `aligned_plain` does, compiled."""
    settled: Callable[..., tuple[Any, ...]] = _kernels.settled
    judged: Callable[..., tuple[Any, ...]] = _kernels.judged
    image_px, near = np.array(image.shape[1::-1], float), np.array(_near_px(template))
    linear, centre, inverse, seen, robust = settled(
        patch.pixels, np.array(patch.corner_px, float), template.pixels, template.spread, template.own, near,
        SHARED_NOISE, image_px, template.step_px, np.asarray(start.linear, float), np.asarray(start.centre_px, float),
        np.asarray(predicted_linear, float), _prior(looseness), ITERATIONS, ENOUGH_PX, ROBUST,
    )  # fmt: skip
    raw, light, residual, agreeing, score, inside = judged(
        template.pixels, template.spread, template.trust, template.core, seen, robust, template.step_px, linear, centre,
        image_px, *TOLERANCE, ROBUST, BRIGHTER,
    )  # fmt: skip
    return Alignment(
        warp=Warp(linear=linear, centre_px=centre),
        covariance_px2=linear @ inverse[:2, :2] @ linear.T,
        score=score,
        agreeing=agreeing,
        inside=inside,
        raw=raw,
        seen=light,
        residual=residual,
    )


def aligned_plain(
    image: Image, template: Template, patch: Patch, start: Warp, predicted_linear: Floats, looseness: float
) -> Alignment:
    """The alignment in plain numpy; `patch` is the image around `start`."""
    columns = _columns(template)
    prior = _prior(looseness)
    weight = _pixel_weight(template, image, start)
    target = template.pixels.reshape(-1)
    warp, robust = start, weight
    inverse, gain = _step_matrix(columns, robust, prior)
    seen = patch.at(warp)
    for iteration in range(ITERATIONS):
        change = seen.reshape(-1) - target
        if iteration == 2:
            robust = weight * _robust(change - columns.T @ (gain @ change), template)
            inverse, gain = _step_matrix(columns, robust, prior)
        off = _shape_offset(warp.linear, predicted_linear)
        step = gain @ change + inverse[:, 2:6] @ (prior[2:6] * off)
        warp = _composed(warp, step)
        seen = patch.at(warp)
        if iteration > 2 and np.hypot(step[0], step[1]) < ENOUGH_PX:
            break
    return _judged(image, template, warp, seen, columns, robust, inverse)


def _columns(template: Template) -> Pixels:
    """The step's columns (10, h w 3): d (2), scale, rotation, shears, gain, brightness of each colour."""
    t = template.pixels
    gx = cv2.Sobel(t, cv2.CV_32F, 1, 0, ksize=1, scale=0.5 / template.step_px, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Sobel(t, cv2.CV_32F, 0, 1, ksize=1, scale=0.5 / template.step_px, borderType=cv2.BORDER_REPLICATE)
    ux, uy = (u.astype(np.float32) for u in template.grid())
    x, y = ux[None, :, None], uy[:, None, None]
    out = np.zeros((10, *t.shape), np.float32)
    out[0], out[1] = gx, gy
    xx, yy, xy, yx = gx * x, gy * y, gx * y, gy * x
    out[2], out[3], out[4], out[5] = xx + yy, yx - xy, xx - yy, xy + yx
    out[6] = t - t.mean(axis=(0, 1))
    for colour in range(3):
        out[7 + colour, :, :, colour] = 1.0
    return out.reshape(10, -1)


@lru_cache(maxsize=64)
def _prior(looseness: float) -> Floats:
    """Diagonal of the prior's information on the step (10,)."""
    brightness = np.full(3, BRIGHTNESS_SIGMA)
    sigma = np.concatenate([[np.inf, np.inf], SHAPE_SIGMA * looseness, [GAIN_SIGMA], brightness])
    return np.asarray(1.0 / sigma**2)


def _pixel_weight(template: Template, image: Image, warp: Warp) -> Pixels:
    """Information of each value (h w 3,) before robust weighting; zero outside the image."""
    weight = _nearness(template) * template.own / (SHARED_NOISE * template.spread)
    weight = weight * _inside(template, image, warp)
    return np.asarray(np.repeat(weight.reshape(-1), 3), np.float32)


def _nearness(template: Template) -> Pixels:
    """How much each pixel (h, w) says about the tracked point: what is near it lies on the same surface."""
    ux, uy = template.grid()
    wide, high = _near_px(template)
    return np.asarray(np.exp(-0.5 * ((ux[None, :] / wide) ** 2 + (uy[:, None] / high) ** 2)), np.float32)


def _near_px(template: Template) -> tuple[float, float]:
    """One sigma of the weight around the tracked point, across and down."""
    width, height = template.size_px
    return max(NEAR * width, LEAST_NEAR_PX), max(NEAR * height, LEAST_NEAR_PX)


def _inside(template: Template, image: Image, warp: Warp) -> Pixels:
    ux, uy = template.grid()
    half = np.abs(warp.linear) @ np.array([ux[-1], uy[-1]])
    height, width = image.shape[:2]
    low, high = warp.centre_px - half, warp.centre_px + half
    if low.min() >= 0 and high[0] <= width - 1 and high[1] <= height - 1:
        return np.ones(template.shape, np.float32)
    x = warp.linear[0, 0] * ux[None, :] + warp.linear[0, 1] * uy[:, None] + warp.centre_px[0]
    y = warp.linear[1, 0] * ux[None, :] + warp.linear[1, 1] * uy[:, None] + warp.centre_px[1]
    return np.asarray((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1), np.float32)


def _robust(residual: Pixels, template: Template) -> Pixels:
    """Weight of each value (h w 3,) by its pixel's residual (Geman-McClure)."""
    squared = (residual.reshape(-1, 3) ** 2).mean(axis=1) / template.spread.reshape(-1)
    return np.asarray(np.repeat(1.0 / (1.0 + squared / ROBUST**2) ** 2, 3), np.float32)


def _step_matrix(columns: Pixels, weight: Pixels, prior: Floats) -> tuple[Floats, Floats]:
    """Inverse of the normal matrix (10, 10), and the matrix (10, n) that makes a step of residuals."""
    weighted = columns * weight
    normal = (weighted @ columns.T).astype(float) + np.diag(prior)
    normal[np.diag_indices(10)] += 1e-9
    inverse = np.linalg.inv(normal)
    return inverse, (inverse.astype(np.float32) @ weighted)


def _shape_offset(linear: Floats, predicted: Floats) -> Floats:
    """D = predicted^-1 linear - 1 as (scale, rotation, shear, shear)."""
    d = np.linalg.solve(predicted, linear) - np.eye(2)
    return np.array([d[0, 0] + d[1, 1], d[1, 0] - d[0, 1], d[0, 0] - d[1, 1], d[0, 1] + d[1, 0]]) / 2


def _composed(warp: Warp, step: Floats) -> Warp:
    s, r, a, b = step[2:6]
    back = np.linalg.inv(np.array([[1 + s + a, b - r], [b + r, 1 + s - a]]))
    linear = warp.linear @ back
    return Warp(linear=linear, centre_px=warp.centre_px - linear @ step[:2])


def _judged(
    image: Image, template: Template, warp: Warp, seen: Pixels, columns: Pixels, robust: Pixels, inverse: Floats
) -> Alignment:
    inside = _inside(template, image, warp)
    light = _light(template, seen, columns, robust)
    residual = ((light - template.pixels) ** 2).mean(axis=2)
    core = template.core & (inside > 0)
    wide = max(1, int(template.core.sum()))
    tolerance = ROBUST**2 * np.clip(template.spread[core], *TOLERANCE)
    trust = template.trust[core]
    agreeing = float((trust * (residual[core] < tolerance)).sum() / max(1e-9, float(trust.sum())))
    position = warp.linear @ inverse[:2, :2] @ warp.linear.T
    return Alignment(
        warp=warp,
        covariance_px2=position,
        score=_score(template, seen, core),
        agreeing=agreeing,
        inside=float(core.sum() / wide),
        raw=seen,
        seen=light,
        residual=np.asarray(residual, np.float32),
    )


def _light(template: Template, seen: Pixels, columns: Pixels, robust: Pixels) -> Pixels:
    """What was seen, at the template's gain and brightness (weighted least squares, one gain for all colours)."""
    weight = robust.reshape(*template.shape, 3)[:, :, :1]
    total = max(1e-12, float(weight.sum()))
    mean_seen = (weight * seen).sum(axis=(0, 1)) / total
    mean_own = (weight * template.pixels).sum(axis=(0, 1)) / total
    s, o = seen - mean_seen, template.pixels - mean_own
    gain = float((weight * s * o).sum() / max(1e-9, float((weight * s * s).sum())))
    brighter = np.clip(mean_seen - mean_own, -BRIGHTER, BRIGHTER)
    return np.asarray(s * np.clip(gain, 0.7, 1.4) + mean_seen - brighter, np.float32)


def _score(template: Template, seen: Pixels, core: np.ndarray) -> float:
    """Correlation over the box, each colour about its own mean, pixels weighted by what is expected of them."""
    if core.sum() < 4:
        return -1.0
    weight = template.trust[core][:, None]
    a, b = template.pixels[core], seen[core]
    total = weight.sum()
    a, b = a - (weight * a).sum(axis=0) / total, b - (weight * b).sum(axis=0) / total
    norm = np.sqrt(float((weight * a * a).sum()) * float((weight * b * b).sum()))
    return float((weight * a * b).sum()) / norm if norm > 1e-6 else 0.0
