"""Looking for a target around where it should be: normalised correlation over a region, then alignment of the peaks."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.tracking.target.alignment import Alignment
from pipeline.tracking.target.template import Pixels, Template, Warp, sample
from pipeline.tracking.video.frames import Image

POOLED_FROM = 16  # template pixels on the shorter side from which half the resolution is enough to search
PEAKS, LARGEST_REACH = 3, 160  # reach in template pixels
DISTANCE_PENALTY = 0.03  # of correlation, for each sigma away from the prediction squared
LEAST_CORRELATION, LEAST_LOG_ODDS = 0.2, 0.1
NOISE = 5.0**2  # squared grey levels that mean nothing

Behind = Callable[[Warp, tuple[int, int], float], Pixels | None]
"""What the scene looks like without the target under a warp: (h, w, 3) for (warp, (h, w), step_px), where known."""


def matches_nearby(
    image: Image,
    template: Template,
    predicted: Warp,
    reach_px: float,
    sigma_px: float,
    aligned: Callable[[Warp], Alignment],
    turn_rad: float = 0.0,
    behind: Behind | None = None,
) -> list[Alignment]:
    """Alignments within `reach_px` of the prediction; none where nothing correlates at all.

    sigma_px  of the prediction, per axis: far from it a match must be better
    aligned   finds the template from a start close by
    turn_rad  by how much the target is to be turned first
    """
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    predicted = Warp(linear=predicted.linear @ np.array([[c, -s], [s, c]]), centre_px=predicted.centre_px)
    return [
        aligned(Warp(linear=predicted.linear, centre_px=start))
        for start in candidates(image, template, predicted, reach_px, sigma_px, behind)
    ]


def candidates(
    image: Image,
    template: Template,
    predicted: Warp,
    reach_px: float,
    sigma_px: float,
    behind: Behind | None = None,
) -> list[Floats]:
    """Up to `PEAKS` places (2,) in the image where the template fits best.

    That is the best correlation; where the scene behind is known, how much better the template explains the place.
    """
    scale = template.step_px * predicted.scale
    reach = int(np.clip(np.ceil(reach_px / scale), 2, LARGEST_REACH)) // 2 * 2
    rows, columns = _core_span(template)
    look, trust = template.pixels[rows, columns], template.trust[rows, columns]
    shape = template.shape[0] + 2 * reach, template.shape[1] + 2 * reach
    inner = slice(rows.start, rows.stop + 2 * reach), slice(columns.start, columns.stop + 2 * reach)
    region = sample(image, predicted, shape, template.step_px)[inner]
    pool = 2 if min(look.shape[:2]) >= POOLED_FROM else 1
    ground = behind(predicted, shape, template.step_px) if behind is not None else None
    if ground is None:
        match, least = _correlation(*(_pooled(p, pool) for p in (region, look, trust))), LEAST_CORRELATION
    else:
        match = _log_odds(*(_pooled(p, pool) for p in (region, ground[inner], look, trust)))
        least = LEAST_LOG_ODDS
    reach = reach // pool
    offset = np.arange(-reach, reach + 1) * scale * pool
    far = (offset[:, None] ** 2 + offset[None, :] ** 2) / sigma_px**2
    merit = np.asarray(match - DISTANCE_PENALTY * far, float)
    apart = max(2, min(look.shape[:2]) // (3 * pool))
    places: list[Floats] = []
    for _ in range(PEAKS):
        y, x = np.unravel_index(int(np.argmax(merit)), merit.shape)
        if match[y, x] < least or not np.isfinite(merit[y, x]):
            break
        shift = np.array([x - reach, y - reach]) * template.step_px * pool
        places.append(predicted.centre_px + predicted.linear @ shift)
        merit[max(0, y - apart) : y + apart + 1, max(0, x - apart) : x + apart + 1] = -np.inf
    return places


def _correlation(region: Pixels, look: Pixels, trust: Pixels) -> Pixels:
    """Correlation of each place, pixels weighted by what is expected of them."""
    mask = np.repeat((trust / trust.max())[:, :, None], 3, axis=2)
    match = cv2.matchTemplate(region, look, cv2.TM_CCOEFF_NORMED, mask=mask)
    return np.nan_to_num(np.asarray(match, np.float32), posinf=0.0, neginf=0.0)


def _log_odds(region: Pixels, ground: Pixels, look: Pixels, trust: Pixels) -> Pixels:
    """Half the logarithm of how much worse the scene behind explains each place than the template does."""
    weight = np.asarray(trust / trust.sum(), np.float32)
    away = ((region - ground) ** 2).mean(axis=2)
    scene = cv2.matchTemplate(away, weight, cv2.TM_CCORR)
    square = cv2.matchTemplate((region**2).mean(axis=2), weight, cv2.TM_CCORR)
    mixed = cv2.matchTemplate(region, look * weight[:, :, None] / 3.0, cv2.TM_CCORR)
    own = square - 2.0 * mixed + float((weight * (look**2).mean(axis=2)).sum())
    return np.asarray(0.5 * np.log((scene + NOISE) / (np.maximum(own, 0.0) + NOISE)), np.float32)


def _pooled(image: Pixels, pool: int) -> Pixels:
    return _halved(image) if pool == 2 else image


def _halved(image: Pixels) -> Pixels:
    """Twice smaller; an odd last row or column is left out."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    even = image[: 2 * h, : 2 * w]
    return np.asarray((even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4, np.float32)


def _core_span(template: Template) -> tuple[slice, slice]:
    """Rows and columns of the box in the template."""
    rows, columns = np.flatnonzero(template.core.any(axis=1)), np.flatnonzero(template.core.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
