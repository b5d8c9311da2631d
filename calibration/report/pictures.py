"""The photos of a calibration, small, with what was found in them drawn in: for the report page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from calibration.judgement.result import CalibratedView, Calibration
from calibration.photos.reading import Photo, find_photos, read_photo
from calibration.photos.videos import video_frames
from calibration.report.figures import ARROW

WIDTH_PX = 360
QUALITY = 72
FOUND, OFF = (218, 105, 9), (46, 34, 207)


def pictures(sources: Sequence[Path], found: Calibration) -> Mapping[str, bytes]:
    """A JPEG for the name of every view that was used, corners blue and residuals (40 times as long) red, and of every
    photo that was not."""
    views = {view.name: view for view in found.views}
    left_out = {view.name for view in found.rejected}
    made: dict[str, bytes] = {}
    for photo in _photos(sources):
        if photo.name in views or photo.name in left_out:
            made[photo.name] = _picture(photo.gray, views.get(photo.name))
    return made


def _photos(sources: Sequence[Path]) -> Iterator[Photo]:
    files = find_photos(sources)
    for path in files.photos:
        yield read_photo(path)
    for path in files.videos:
        yield from video_frames(path)


def _picture(gray: cv2.typing.MatLike, view: CalibratedView | None) -> bytes:
    scale = min(1.0, WIDTH_PX / gray.shape[1])
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    colour = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    if view is not None:
        begin = (view.corners + 0.5) * scale - 0.5
        end = begin + ARROW * scale * view.residual_px
        for a, b in zip(np.rint(16 * begin).astype(int), np.rint(16 * end).astype(int), strict=True):
            cv2.line(colour, a.tolist(), b.tolist(), OFF, 1, cv2.LINE_AA, 4)
            cv2.circle(colour, a.tolist(), 20, FOUND, -1, cv2.LINE_AA, 4)
    return cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
