"""What a target looks like, around the one point of it that is tracked.

A template is a small picture in coordinates u (pixels of the first box's frame, origin at the first box's centre) with
a spread for each of its pixels: the squared residual to be expected there. A warp (A, t) puts it into an image,
x = A u + t, so t is where the tracked point is. Pixels that do not belong to the target (corners of the box, road
seen past the edge) disagree from frame to frame, their spread grows, and they stop counting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats
from pipeline.tracking.records import changed
from pipeline.tracking.video.frames import Image

Pixels = npt.NDArray[np.float32]

LARGEST_PIXELS = 1600  # finer templates gain nothing
SMOOTHING_PX = 0.7  # of image and template alike, in template pixels: against noise and interpolation error
# squared grey levels: of a pixel that surely belongs to the target, of the box's corners, of the margin, at most
DOUBT = 7.0**2  # added to the spread of a pixel where it votes
LEAST_OWN, KNOWN = 0.03, 1.5  # say of a pixel that is surely the scene's; how soon what is known of that is believed
GROUND_SPREAD = 8.0**2  # of known ground beside the target
NOISE_SPREAD, CORNER_SPREAD, OUTSIDE_SPREAD, LARGEST_SPREAD = 5.0**2, 10.0**2, 25.0**2, 40.0**2


@dataclass(frozen=True, kw_only=True, eq=False)
class Warp:
    """Where a template lies in an image: x = linear @ u + centre_px."""

    linear: Floats
    centre_px: Floats

    @property
    def scale(self) -> float:
        """Image pixels for one of u, as if it were the same in every direction."""
        return scale_of(self.linear)


def scale_of(linear: Floats) -> float:
    """Square root of the area that (2, 2) makes of a unit square; written out, as it is wanted often."""
    (a, b), (c, d) = linear.tolist()
    return math.sqrt(abs(a * d - b * c))


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """A target's look.

    pixels   (h, w, 3) smoothed, grey levels
    spread   (h, w) expected squared residual
    apart    (h, w) expected squared difference from the scene behind, times `compared`
    compared how much is known of that, 0 to 1: nothing until the target has moved in front of the scene
    own      (h, w) how far each pixel belongs to the target, up to 1: those that follow it and differ from the scene;
             all the same as long as nothing is known
    core     (h, w) true inside the first box
    step_px  distance of neighbouring template pixels in u
    size_px  (width, height) of the first box
    """

    pixels: Pixels
    spread: Pixels
    apart: Pixels
    own: Pixels
    core: Bools
    step_px: float
    size_px: tuple[float, float]
    compared: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) of the picture."""
        return self.pixels.shape[0], self.pixels.shape[1]

    @property
    def size(self) -> float:
        """Geometric mean of the first box's sides."""
        return math.sqrt(self.size_px[0] * self.size_px[1])

    @cached_property
    def trust(self) -> Pixels:
        """(h, w) the say of each pixel in whether this is the target."""
        return np.asarray(self.own / (self.spread + DOUBT), np.float32)

    @property
    def proven(self) -> Bools:
        """(h, w) true for pixels that surely belong to the target."""
        return np.asarray(self.apart > 2.0 * (self.spread + NOISE_SPREAD))

    def grid(self) -> tuple[Floats, Floats]:
        """The u coordinates of the columns (w,) and rows (h,)."""
        h, w = self.shape
        columns, rows = np.arange(w) - (w - 1) / 2, np.arange(h) - (h - 1) / 2
        return np.asarray(columns * self.step_px, float), np.asarray(rows * self.step_px, float)


def first_template(image: Image, centre_px: Floats, size_px: tuple[float, float]) -> Template:
    """The template of a box: the box and a narrow margin around it."""
    margin = max(1.0, 0.06 * min(size_px))
    wide, high = size_px[0] + 2 * margin, size_px[1] + 2 * margin
    step = max(1.0, float(np.sqrt(wide * high / LARGEST_PIXELS)))
    h, w = max(5, round(high / step)), max(5, round(wide / step))
    ux, uy = (np.arange(w) - (w - 1) / 2) * step, (np.arange(h) - (h - 1) / 2) * step
    core = (np.abs(ux)[None, :] <= size_px[0] / 2) & (np.abs(uy)[:, None] <= size_px[1] / 2)
    start = Warp(linear=np.eye(2), centre_px=np.asarray(centre_px, float))
    pixels = sample(image, start, (h, w), step)
    oval = (ux[None, :] / size_px[0]) ** 2 + (uy[:, None] / size_px[1]) ** 2 <= 0.25
    spread = np.where(oval, NOISE_SPREAD, np.where(core, CORNER_SPREAD, OUTSIDE_SPREAD)).astype(np.float32)
    nothing, every = np.zeros_like(spread), np.ones_like(spread)
    return Template(
        pixels=pixels, spread=spread, apart=nothing, own=every, core=core, step_px=step, size_px=size_px
    )  # fmt: skip


def informed(template: Template, known: Template) -> Template:
    """The first look of a target whose pixels are known from elsewhere: which are its own, and how much they differ."""
    return replace(template, spread=known.spread, apart=known.apart, own=known.own, compared=known.compared)


def sample(image: Image, warp: Warp, shape: tuple[int, int], step_px: float, reach_px: float = 0.0) -> Pixels:
    """The image (h, w, 3) as a template of `shape` would see it under `warp`, smoothed; edges repeat outside.

    reach_px  how far beyond the footprint to read
    """
    return Patch.cut(image, warp, shape, step_px, reach_px).at(warp)


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """A smoothed piece of an image around a warp, to be sampled at warps close by."""

    pixels: Pixels
    corner_px: tuple[int, int]
    shape: tuple[int, int]
    step_px: float

    @staticmethod
    def cut(image: Image, warp: Warp, shape: tuple[int, int], step_px: float, reach_px: float) -> Patch:
        """The piece that `shape` covers under `warp`, `reach_px` more on every side."""
        smoothing = SMOOTHING_PX * step_px * warp.scale
        (a, b), (c, d) = warp.linear.tolist()
        x, y = warp.centre_px.tolist()
        half_w, half_h = shape[1] * step_px / 2, shape[0] * step_px / 2
        half_x, half_y = abs(a) * half_w + abs(b) * half_h, abs(c) * half_w + abs(d) * half_h
        border = reach_px + 3 * smoothing + 2
        height, width = image.shape[:2]
        left, top = math.floor(x - half_x - border), math.floor(y - half_y - border)
        right, bottom = math.ceil(x + half_x + border) + 1, math.ceil(y + half_y + border) + 1
        left, right = min(max(left, 0), width - 1), max(min(right, width), 1)
        top, bottom = min(max(top, 0), height - 1), max(min(bottom, height), 1)
        piece = image[top : max(bottom, top + 1), left : max(right, left + 1)].astype(np.float32)
        smooth = cv2.GaussianBlur(piece, (0, 0), smoothing, borderType=cv2.BORDER_REPLICATE)
        return Patch(pixels=np.asarray(smooth, np.float32), corner_px=(left, top), shape=shape, step_px=step_px)

    def at(self, warp: Warp) -> Pixels:
        """The piece seen under `warp` (h, w, 3)."""
        h, w = self.shape
        linear = warp.linear * self.step_px
        corner = warp.centre_px - linear @ np.array([(w - 1) / 2, (h - 1) / 2]) - np.array(self.corner_px, float)
        seen = cv2.warpAffine(
            self.pixels,
            np.column_stack([linear, corner]),
            (w, h),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(seen, np.float32)


def adapted(template: Template, seen: Pixels, residual: Pixels, rate: float, spread_rate: float) -> Template:
    """The template after an accepted frame.

    seen         (h, w, 3) the frame under the found warp, brought to the template's brightness
    residual     (h, w) squared residual, mean over the colours
    rate         share of the frame that enters the look; zero while part of the target may be covered: then only the
                 pixels not proven to be the target's learn how much they may differ
    spread_rate  share of the frame that enters the spread
    """
    share = np.where(template.proven, np.float32(spread_rate if rate > 0 else 0.0), np.float32(spread_rate))
    spread = template.spread + share * (np.minimum(residual, LARGEST_SPREAD) - template.spread)
    return changed(
        template,
        pixels=template.pixels + np.float32(rate) * (seen - template.pixels),
        spread=np.maximum(spread, NOISE_SPREAD / 4).astype(np.float32),
    )


def over_ground(template: Template, ground: Pixels) -> Template:
    """The template as it should look over known ground (h, w, 3): its outline tells as much as its inside."""
    own = cv2.GaussianBlur(template.own, (0, 0), SMOOTHING_PX, borderType=cv2.BORDER_REPLICATE)
    pixels = ground + own[:, :, None] * (template.pixels - ground)
    spread = GROUND_SPREAD + own * (template.spread - GROUND_SPREAD)
    every = np.ones_like(template.own)
    return changed(template, pixels=pixels, spread=np.maximum(spread, NOISE_SPREAD / 4), own=every)


def contrasted(template: Template, difference: Pixels, rate: float) -> Template:
    """The template after its pixels were compared with the scene behind: `difference` (h, w) squared."""
    apart = template.apart + np.float32(rate) * (np.minimum(difference, LARGEST_SPREAD) - template.apart)
    compared = template.compared + rate * (1.0 - template.compared)
    told = np.clip(apart / (compared * (template.spread + NOISE_SPREAD)) - 0.5, LEAST_OWN, 1.5)
    own = 1.0 + min(1.0, KNOWN * compared) * (told / told.max() - 1.0)
    return changed(template, apart=apart.astype(np.float32), own=own.astype(np.float32), compared=compared)
