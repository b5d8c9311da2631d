"""The country that is rendered: one large ground texture, and solids (trees, houses, a bridge) as flat polygons.

Texture pixel (column, row) covers the ground at east = (column + 0.5) texel - half, north = half - (row + 0.5) texel.
Detail fades with distance from the middle, where cameras look at the ground so flatly that it could only alias.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats, Ints
from pipeline.synthetic.scene import Bridge, Landscape, Road

Image = npt.NDArray[np.uint8]
SHIFT = 4
ASPHALT = (104, 102, 100)
VERGE = (104, 124, 128)
WHITE = (214, 218, 220)
CONCRETE = (158, 164, 166)
FIELDS = ((88, 138, 116), (74, 122, 104), (104, 152, 150), (96, 168, 176), (84, 112, 96), (112, 140, 156))
SHADE = 0.62
SUN = np.array([0.55, 0.45])
"""Shadow of a point one metre above the ground, east and north."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """Flat polygons drawn in order over whatever lies behind.

    corners_enu_m  one (n, 3) per polygon
    colours        blue, green, red of each
    """

    corners_enu_m: tuple[Floats, ...]
    colours: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Country:
    """What `paint` makes of a Landscape.

    ground            (rows, columns, 3) blue, green, red
    texel_from_plane  (3, 3): east, north, 1 on the ground to column, row, 1 of the texture
    solids            trees and houses
    bridge            the bridge, drawn after the vehicles and before the solids
    """

    ground: Image
    texel_from_plane: Floats
    solids: tuple[Solid, ...]
    bridge: Solid | None


def paint(landscape: Landscape) -> Country:
    """Paint the country; the same landscape gives the same pixels."""
    rng = np.random.default_rng([landscape.seed, 2])
    half, texel = landscape.half_size_m, landscape.texel_m
    texel_from_plane = np.array(
        [[1 / texel, 0.0, half / texel - 0.5], [0.0, -1 / texel, half / texel - 0.5], [0.0, 0.0, 1.0]]
    )
    side = round(2 * half / texel)
    trees = _tree_places(landscape, rng)
    houses = _house_places(landscape, rng)
    ground = _fields(side, texel, rng)
    _draw_roads(ground, landscape.roads, texel_from_plane, texel)
    ground = _wear(ground, texel, rng)
    solids = tuple(_tree(place, rng) for place in trees) + tuple(_house(place) for place in houses)
    bridge = None if landscape.bridge is None else _bridge(landscape.bridge)
    _cast_shadows(ground, (*solids, *(() if bridge is None else (bridge,))), texel_from_plane, texel)
    return Country(ground=_fade(ground, texel), texel_from_plane=texel_from_plane, solids=solids, bridge=bridge)


def _fields(side: int, texel_m: float, rng: np.random.Generator) -> Image:
    """A patchwork of turned rectangles, each with the lines of its crop."""
    image = np.empty((side, side, 3), np.uint8)
    image[:] = FIELDS[0]
    patch = 95.0 / texel_m
    count = int(side / patch) + 2
    turn = np.radians(14.0)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for i in range(-count, 2 * count):
        for j in range(-count, count):
            corner = np.array([i * patch * 1.5, j * patch]) + rng.uniform(-0.15, 0.15, 2) * patch
            size = np.array([1.6, 1.1]) * patch * rng.uniform(0.8, 1.0, 2)
            colour = np.array(FIELDS[rng.integers(len(FIELDS))]) + rng.integers(-8, 9, 3)
            box = (corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size) @ axes.T
            if (box.max(axis=0) < 0).any() or (box.min(axis=0) > side).any():
                continue
            cv2.fillPoly(image, [_fixed(box)], _colour(colour), cv2.LINE_AA, SHIFT)
            for k in range(1, int(size[1] * texel_m / 4)):
                row = corner + np.array([[0.0, k * 4 / texel_m], [size[0], k * 4 / texel_m]])
                shade = _colour(colour - 9 if k % 2 else colour + 7)
                ends = _fixed(row @ axes.T)
                cv2.polylines(image, [ends], False, shade, max(1, round(1.2 / texel_m)), cv2.LINE_AA, SHIFT)
    return image


def _draw_roads(image: Image, roads: tuple[Road, ...], texel_from_plane: Floats, texel_m: float) -> None:
    """Verges first, then edges, then asphalt over the edges of crossing roads, then the dashes."""

    def stroke(line_m: Floats, wide_m: float, colour: tuple[int, int, int]) -> None:
        points = _fixed(_apply(texel_from_plane, line_m))
        cv2.polylines(image, [points], False, colour, max(1, round(wide_m / texel_m)), cv2.LINE_AA, SHIFT)

    for colour, wider_m in ((VERGE, 4.0), (ASPHALT, 0.0), (WHITE, -1.2), (ASPHALT, -1.8)):
        for road in roads:
            stroke(road.line_m, road.width_m + wider_m, colour)
    for road in roads:
        for dash in _dashes(road.line_m, on_m=4.0, off_m=6.0):
            stroke(dash, 0.3, WHITE)


def _wear(image: Image, texel_m: float, rng: np.random.Generator) -> Image:
    """Brightness that varies over every scale from 40 m down to one texel."""
    side = image.shape[0]
    total: npt.NDArray[np.float32] = np.zeros((side, side), np.float32)
    for scale_m, share in ((40.0, 5.0), (12.0, 5.0), (4.0, 5.0), (1.3, 6.0), (texel_m, 4.0)):
        count = max(8, round(side * texel_m / scale_m))
        grain = rng.standard_normal((count, count), dtype=np.float32) * share
        total += np.asarray(cv2.resize(grain, (side, side), interpolation=cv2.INTER_LINEAR))
    return np.asarray(cv2.add(image, cv2.merge([total, total, total]), dtype=cv2.CV_8U), np.uint8)


def _cast_shadows(image: Image, solids: tuple[Solid, ...], texel_from_plane: Floats, texel_m: float) -> None:
    mask = np.zeros(image.shape[:2], np.uint8)
    for solid in solids:
        for corners in solid.corners_enu_m:
            flat = corners[:, :2] + corners[:, 2:] * SUN
            cv2.fillPoly(mask, [_fixed(_apply(texel_from_plane, flat))], 255, cv2.LINE_AA, SHIFT)
    soft = np.asarray(cv2.GaussianBlur(mask, (0, 0), 0.4 / texel_m))
    for row in np.flatnonzero(soft.any(axis=1)):
        keep = 1 - (1 - SHADE) / 255 * soft[row].astype(np.float32)
        image[row] = (image[row] * keep[:, None]).astype(np.uint8)


def _fade(image: Image, texel_m: float) -> Image:
    """Blur grows with distance from the middle: none at 150 m, 1.2 m beyond 300 m."""
    side = image.shape[0]
    soft = cv2.GaussianBlur(image, (0, 0), 1.2 / texel_m)
    small = np.linspace(-1, 1, 256, dtype=np.float32) * (side * texel_m / 2)
    radius = np.hypot(*np.meshgrid(small, small))
    share = cv2.resize(np.clip((radius - 150) / 150, 0, 1), (side, side))
    return np.asarray(cv2.blendLinear(image, soft, 1 - share, share), np.uint8)


def _tree_places(landscape: Landscape, rng: np.random.Generator) -> Floats:
    """East, north, height, radius (n, 4): rows beside fields and small woods, away from roads and the bridge."""
    reach = min(landscape.half_size_m, 330.0)
    woods = rng.uniform(-reach, reach, (14, 2))
    single = rng.uniform(-reach, reach, (150, 2))
    grown = np.concatenate([w + rng.normal(0, 9.0, (int(rng.integers(5, 16)), 2)) for w in woods])
    place = np.concatenate([grown, single])
    size = np.stack([rng.uniform(5.0, 9.0, len(place)), rng.uniform(2.2, 4.2, len(place))], axis=1)
    return np.hstack([place, size])[_clear_of_roads(place, landscape, 14.0)]


def _house_places(landscape: Landscape, rng: np.random.Generator) -> Floats:
    """East, north, turn (n, 3)."""
    reach = min(landscape.half_size_m, 280.0)
    place = rng.uniform(-reach, reach, (26, 2))
    spin = rng.uniform(0, np.pi, (26, 1))
    return np.hstack([place, spin])[_clear_of_roads(place, landscape, 26.0)]


def _clear_of_roads(place: Floats, landscape: Landscape, gap_m: float) -> npt.NDArray[np.bool_]:
    clear = np.ones(len(place), bool)
    for road in landscape.roads:
        line = road.line_m.astype(np.float32).reshape(-1, 1, 2)
        loop = np.concatenate([line, line[::-1]])
        away = [abs(cv2.pointPolygonTest(loop, (float(e), float(n)), True)) for e, n in place]
        clear &= np.array(away) > gap_m + road.width_m / 2
    if landscape.bridge is not None:
        clear &= np.hypot(*(place - np.array(landscape.bridge.centre_enu_m[:2])).T) > 62.0
    return clear


def _tree(place: Floats, rng: np.random.Generator) -> Solid:
    """A crown of four blobs that grow smaller and lighter towards the top."""
    east, north, height, radius = place
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    green = np.array([46, 92, 70]) + rng.integers(-10, 11, 3)
    corners, colours = [], []
    for share, wide, light in ((0.35, 1.0, -16), (0.6, 0.95, 0), (0.82, 0.72, 14), (1.0, 0.4, 26)):
        r = radius * wide * rng.uniform(0.8, 1.15, len(turn))
        blob = np.stack([east + r * np.sin(turn), north + r * np.cos(turn), np.full(len(turn), height * share)], 1)
        corners.append(blob)
        colours.append(_colour(green + light))
    return Solid(corners_enu_m=tuple(corners), colours=tuple(colours))


def _house(place: Floats) -> Solid:
    """Four walls and a saddle roof."""
    east, north, turn = place
    long, wide, eaves, ridge = 7.0, 4.5, 4.0, 6.8
    spin = np.array([[np.sin(turn), np.cos(turn)], [np.cos(turn), -np.sin(turn)]])

    def at(a: float, b: float, up: float) -> Floats:
        flat = np.array([east, north]) + np.array([a, b]) @ spin
        return np.array([flat[0], flat[1], up])

    ring = [(-long, -wide), (long, -wide), (long, wide), (-long, wide)]
    corners = [
        np.array([at(*p, 0.0), at(*q, 0.0), at(*q, eaves), at(*p, eaves)])
        for p, q in zip(ring, ring[1:] + ring[:1], strict=True)
    ]
    tops = [(at(-long, 0.0, ridge), at(long, 0.0, ridge), side) for side in (-1, 1)]
    slopes = [np.array([a, b, at(long, s * wide, eaves), at(-long, s * wide, eaves)]) for a, b, s in tops]
    walls = ((150, 176, 190), (136, 160, 172), (160, 184, 196), (140, 164, 178))
    return Solid(corners_enu_m=(*corners, *slopes), colours=(*walls, (70, 82, 150), (62, 72, 128)))


def _bridge(bridge: Bridge) -> Solid:
    """Ramps, the sides of the deck and the deck with its marks; the deck's outline is what hides targets."""
    east, north, up = bridge.centre_enu_m
    along = np.array([np.sin(bridge.heading_rad), np.cos(bridge.heading_rad)])
    across = np.array([along[1], -along[0]])
    half, ramp, wide = bridge.length_m / 2, bridge.length_m / 2 + 45.0, bridge.width_m / 2

    def strip(ends: tuple[tuple[float, float], ...], left: float, right: float) -> Floats:
        """Corners of a strip along the road through (distance, height) pairs, between two lateral distances."""
        sides = [(d, z, left) for d, z in ends] + [(d, z, right) for d, z in ends[::-1]]
        return np.array([[*(np.array([east, north]) + d * along + s * across), z] for d, z, s in sides])

    def wall(ends: tuple[tuple[float, float], ...], side: float, foot: float) -> Floats:
        line = [*ends, *((d, foot) for d, _ in ends[::-1])]
        return np.array([[*(np.array([east, north]) + d * along + side * across), z] for d, z in line])

    def split(a: float, b: float) -> tuple[float, ...]:
        return tuple(np.linspace(a, b, 9))

    deck = tuple((d, up) for d in split(-half, half))
    slopes = [((s * ramp, 0.0), (s * half, up)) for s in (-1, 1)]
    parts = [(wall(slope, s * wide, 0.0), VERGE) for slope in slopes for s in (-1, 1)]
    parts += [(strip(slope, -wide, wide), ASPHALT) for slope in slopes]
    parts += [(wall(deck, s * wide, up - 1.2), CONCRETE) for s in (-1, 1)]
    parts += [(strip(deck, -wide, wide), CONCRETE), (strip(deck, -wide + 0.8, wide - 0.8), ASPHALT)]
    parts += [(strip(deck, s * (wide - 1.5) - 0.12, s * (wide - 1.5) + 0.12), WHITE) for s in (-1, 1)]
    parts += [
        (strip(slope, s * (wide - 1.0) - 0.12, s * (wide - 1.0) + 0.12), WHITE) for slope in slopes for s in (-1, 1)
    ]
    height = ((-ramp, -half, half, ramp), (0.0, up, up, 0.0))
    for d in np.arange(-ramp + 4, ramp - 4, 10.0):
        ends = tuple((x, float(np.interp(x, *height))) for x in (d, d + 4.0))
        parts.append((strip(ends, -0.14, 0.14), WHITE))
    return Solid(corners_enu_m=tuple(p for p, _ in parts), colours=tuple(c for _, c in parts))


def _dashes(line_m: Floats, on_m: float, off_m: float) -> list[Floats]:
    """Pieces (3, 2) of a line, `on_m` long with gaps of `off_m`, within 500 m of the middle."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))])
    starts = np.arange(0.0, length[-1] - on_m, on_m + off_m)
    at = starts[:, None] + np.linspace(0, on_m, 3)
    pieces = np.stack([np.interp(at, length, line_m[:, k]) for k in range(2)], axis=2)
    return list(pieces[np.abs(pieces).max(axis=(1, 2)) < 500])


def _apply(dst_from_src: Floats, points: Floats) -> Floats:
    return np.asarray(points @ dst_from_src[:2, :2].T + dst_from_src[:2, 2])


def _fixed(points: Floats) -> Ints:
    """Pixel coordinates as OpenCV's drawing takes them, with `SHIFT` bits below the pixel."""
    return np.asarray(np.round(points * (1 << SHIFT)).astype(np.int32))


def _colour(value: npt.ArrayLike) -> tuple[int, int, int]:
    blue, green, red = (int(v) for v in np.clip(value, 0, 255))
    return blue, green, red
