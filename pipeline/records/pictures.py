"""Moments of the videos, cut out for people to look at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

PictureKind = Literal["first", "outlier", "lost", "found"]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What one frame shows around a target.

    kind        its first fix in this camera, an outlier, the last fix before a loss, the first fix after it
    time_s      common time
    jpeg        the cut-out, `size` (width, height) pixels of its own, each `1 / zoom` of the video's
    corner_px   image coordinates of its top-left corner; pixel (0, 0) of the video reaches from -0.5 to 0.5
    fix_px      where the target was tracked; predicted_px where the solution has it, NaN where it took no part
    box_px      left, top, width, height of the box that a person drew on this frame
    residual_px, residual_sigma, weight   of the sighting; NaN where it took no part
    """

    kind: PictureKind
    camera: str
    target: str
    frame: int
    time_s: float
    jpeg: bytes
    size: tuple[int, int]
    corner_px: tuple[float, float]
    zoom: float
    fix_px: tuple[float, float]
    predicted_px: tuple[float, float] = (math.nan, math.nan)
    box_px: tuple[float, float, float, float] | None = None
    residual_px: float = math.nan
    residual_sigma: float = math.nan
    weight: float = math.nan

    def place(self, xy_px: tuple[float, float]) -> tuple[float, float]:
        """Where in the cut-out a point of the image is, in the cut-out's pixels from its corner."""
        return (xy_px[0] - self.corner_px[0]) * self.zoom, (xy_px[1] - self.corner_px[1]) * self.zoom


@dataclass(frozen=True, kw_only=True)
class Film:
    """Frames of one camera over the flight, small: what it showed at a moment.

    frame, time_s  of each, increasing; common time
    jpeg           of each, `size` (width, height) pixels
    marks          of each: target, and where it was tracked, in shares of the picture's width and height
    """

    camera: str
    frame: tuple[int, ...]
    time_s: tuple[float, ...]
    jpeg: tuple[bytes, ...]
    size: tuple[int, int]
    marks: tuple[tuple[tuple[str, float, float], ...], ...]


@dataclass(frozen=True, kw_only=True)
class GroundPicture:
    """The ground from above: frames of the videos, projected on it. Clear where no camera saw it well.

    west_m, south_m, east_m, north_m  ENU edges
    webp     the picture, north up
    words    how it was made, one sentence
    """

    west_m: float
    south_m: float
    east_m: float
    north_m: float
    webp: bytes
    words: str
