"""Looking for a target around where it should be: normalised correlation over a region, then alignment of the peaks."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import Floats
from pipeline.tracking.align import Alignment, align
from pipeline.tracking.template import Pixels, Template, Warp, sample
from pipeline.tracking.video import Image

POOLED_FROM = 16  # template pixels on the shorter side from which half the resolution is enough to search
PEAKS, LARGEST_REACH = 3, 160  # reach in template pixels
DISTANCE_PENALTY = 0.03  # of correlation, for each sigma away from the prediction squared


def best_nearby(
    image: Image,
    template: Template,
    predicted: Warp,
    reach_px: float,
    sigma_px: float,
    looseness: float,
    turn_rad: float = 0.0,
) -> Alignment | None:
    """The best alignment within `reach_px` of the prediction; None where nothing correlates at all.

    sigma_px  of the prediction, per axis: far from it a match must be better
    turn_rad  by how much the target is to be turned first
    """
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    predicted = Warp(linear=predicted.linear @ np.array([[c, -s], [s, c]]), centre_px=predicted.centre_px)
    found = [
        align(image, template, Warp(linear=predicted.linear, centre_px=start), predicted.linear, looseness)
        for start in candidates(image, template, predicted, reach_px, sigma_px)
    ]
    return max(found, key=lambda a: a.score, default=None)


def candidates(image: Image, template: Template, predicted: Warp, reach_px: float, sigma_px: float) -> list[Floats]:
    """Up to `PEAKS` places (2,) in the image where the template correlates best."""
    scale = template.step_px * predicted.scale
    reach = int(np.clip(np.ceil(reach_px / scale), 2, LARGEST_REACH)) // 2 * 2
    rows, columns = _core_span(template)
    look = template.pixels[rows, columns]
    h, w = template.shape
    region = sample(image, predicted, (h + 2 * reach, w + 2 * reach), template.step_px)
    region = region[rows.start : rows.stop + 2 * reach, columns.start : columns.stop + 2 * reach]
    match, pool = _correlation(region, look, template.trust[rows, columns])
    reach = reach // pool
    offset = np.arange(-reach, reach + 1) * scale * pool
    far = (offset[:, None] ** 2 + offset[None, :] ** 2) / sigma_px**2
    merit = np.asarray(match - DISTANCE_PENALTY * far, float)
    apart = max(2, min(look.shape[:2]) // (3 * pool))
    places: list[Floats] = []
    for _ in range(PEAKS):
        y, x = np.unravel_index(int(np.argmax(merit)), merit.shape)
        if match[y, x] < 0.2:
            break
        shift = np.array([x - reach, y - reach]) * template.step_px * pool
        places.append(predicted.centre_px + predicted.linear @ shift)
        merit[max(0, y - apart) : y + apart + 1, max(0, x - apart) : x + apart + 1] = -np.inf
    return places


def _correlation(region: Pixels, look: Pixels, trust: Pixels) -> tuple[Pixels, int]:
    """Correlation of each place, pixels weighted by what is expected of them; and by how much it was made coarser."""
    trust = trust / trust.max()
    pool = 2 if min(look.shape[:2]) >= POOLED_FROM else 1
    if pool == 2:
        region, look, trust = _halved(region), _halved(look), _halved(trust)
    match = cv2.matchTemplate(region, look, cv2.TM_CCOEFF_NORMED, mask=np.repeat(trust[:, :, None], 3, axis=2))
    return np.nan_to_num(np.asarray(match, np.float32), posinf=0.0, neginf=0.0), pool


def _halved(image: Pixels) -> Pixels:
    """Twice smaller; an odd last row or column is left out."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    even = image[: 2 * h, : 2 * w]
    return np.asarray((even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4, np.float32)


def _core_span(template: Template) -> tuple[slice, slice]:
    """Rows and columns of the box in the template."""
    rows, columns = np.flatnonzero(template.core.any(axis=1)), np.flatnonzero(template.core.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
