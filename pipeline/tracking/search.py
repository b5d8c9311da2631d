"""Looking for a target around where it should be: normalised correlation over a region, then alignment of the peaks."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import Floats
from pipeline.tracking.align import Alignment, align
from pipeline.tracking.template import Template, Warp, sample
from pipeline.tracking.video import Image

PEAKS, LARGEST_REACH = 3, 160  # reach in template pixels
DISTANCE_PENALTY = 0.03  # of correlation, for each sigma away from the prediction squared


def best_nearby(
    image: Image, template: Template, predicted: Warp, reach_px: float, sigma_px: float, looseness: float
) -> Alignment | None:
    """The best alignment within `reach_px` of the prediction; None where nothing correlates at all.

    sigma_px  of the prediction, per axis: far from it a match must be better
    """
    found = [
        align(image, template, Warp(linear=predicted.linear, centre_px=start), predicted.linear, looseness)
        for start in candidates(image, template, predicted, reach_px, sigma_px)
    ]
    return max(found, key=lambda a: a.score, default=None)


def candidates(image: Image, template: Template, predicted: Warp, reach_px: float, sigma_px: float) -> list[Floats]:
    """Up to `PEAKS` places (2,) in the image where the template correlates best."""
    scale = template.step_px * float(np.sqrt(abs(np.linalg.det(predicted.linear))))
    reach = int(np.clip(np.ceil(reach_px / scale), 2, LARGEST_REACH))
    rows, columns = _core_span(template)
    look = template.pixels[rows, columns]
    h, w = template.shape
    region = sample(image, predicted, (h + 2 * reach, w + 2 * reach), template.step_px)
    region = region[rows.start : rows.stop + 2 * reach, columns.start : columns.stop + 2 * reach]
    match = cv2.matchTemplate(region, look, cv2.TM_CCOEFF_NORMED)
    offset = np.arange(-reach, reach + 1) * scale
    far = (offset[:, None] ** 2 + offset[None, :] ** 2) / sigma_px**2
    merit = np.asarray(match - DISTANCE_PENALTY * far, float)
    apart = max(2, min(look.shape[:2]) // 3)
    places: list[Floats] = []
    for _ in range(PEAKS):
        y, x = np.unravel_index(int(np.argmax(merit)), merit.shape)
        if match[y, x] < 0.2:
            break
        shift = np.array([x - reach, y - reach]) * template.step_px
        places.append(predicted.centre_px + predicted.linear @ shift)
        merit[max(0, y - apart) : y + apart + 1, max(0, x - apart) : x + apart + 1] = -np.inf
    return places


def _core_span(template: Template) -> tuple[slice, slice]:
    """Rows and columns of the box in the template."""
    rows, columns = np.flatnonzero(template.core.any(axis=1)), np.flatnonzero(template.core.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
