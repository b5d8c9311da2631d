"""Frames of a video over the whole flight, small, to stand beside the slider of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import Film, ImageTrack
from pipeline.stages.inputs.single_frames import Pixels
from pipeline.stages.pictures.settings import PictureSettings


def evenly(time_s: Floats, span_s: tuple[float, float], count: int) -> list[int]:
    """Frames of a video (n,) common times, evenly over a span, the coarsest spacing first; fewer where it is short."""
    inside = np.flatnonzero((time_s >= span_s[0]) & (time_s <= span_s[1]))
    if not len(inside):
        return []
    wanted = np.linspace(time_s[inside[0]], time_s[inside[-1]], count)
    nearest = inside[np.abs(time_s[inside][None, :] - wanted[:, None]).argmin(axis=1)]
    bits = max(1, int(count - 1).bit_length())
    order = sorted(range(count), key=lambda i: int(f"{i:0{bits}b}"[::-1], 2))
    return list(dict.fromkeys(nearest[order].tolist()))


def shrunk(shown: Pixels, settings: PictureSettings) -> tuple[bytes, tuple[int, int]]:
    """A frame (h, w, 3) as a small JPEG, and its size."""
    height, width = shown.shape[:2]
    scale = min(1.0, settings.film_px / max(width, height))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA)
    good, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, settings.film_quality])
    assert good
    return jpeg.tobytes(), size


def film_of(
    camera: str,
    time_s: Floats,
    found: Mapping[int, tuple[bytes, tuple[int, int]]],
    tracks: Sequence[ImageTrack],
    image_size: tuple[int, int],
    most_bytes: float,
) -> Film | None:
    """The film of the frames `found`; every second one of them where they are more than `most_bytes`."""
    frames = sorted(found)
    while len(frames) > 2 and sum(len(found[f][0]) for f in frames) > most_bytes:
        frames = frames[::2]
    if not frames:
        return None
    return Film(
        camera=camera,
        frame=tuple(frames),
        time_s=tuple(float(time_s[f]) for f in frames),
        jpeg=tuple(found[f][0] for f in frames),
        size=found[frames[0]][1],
        marks=tuple(_marks(camera, f, tracks, image_size) for f in frames),
    )


def _marks(
    camera: str, frame: int, tracks: Sequence[ImageTrack], image_size: tuple[int, int]
) -> tuple[tuple[str, float, float], ...]:
    marks = []
    for track in tracks:
        at = int(np.searchsorted(track.frame, frame))
        if track.camera != camera or at >= len(track.frame) or track.frame[at] != frame or not track.seen[at]:
            continue
        x, y = ((float(p) + 0.5) / side for p, side in zip(track.xy_px[at], image_size, strict=True))
        marks.append((track.target, round(x, 4), round(y, 4)))
    return tuple(marks)
