"""Vehicles as polygons in their own axes: forward, left, up from the roof's centre, which is the reference point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.synthetic.scene import SceneTarget, VehicleShape

GLASS = (52, 44, 40)
TYRE = (38, 38, 40)


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """A vehicle that can be drawn.

    shadow    (4, 3) on the ground, drawn soft and dark
    walls     four (4, 3), each with the direction (3,) it faces
    roof      polygons (n, 3) in drawing order; the first is the whole roof
    *_colour  blue, green, red of each
    """

    shadow: Floats
    walls: tuple[Floats, ...]
    facing: tuple[Floats, ...]
    wall_colour: tuple[tuple[int, int, int], ...]
    roof: tuple[Floats, ...]
    roof_colour: tuple[tuple[int, int, int], ...]


def body(shape: VehicleShape) -> Body:
    """The polygons of a shape. Everything below the skirt lies in the soft shadow and is not drawn."""
    a, b, low = shape.length_m / 2, shape.width_m / 2, -shape.skirt_m
    ring = [(a, b), (-a, b), (-a, -b), (a, -b)]
    pairs = list(zip(ring, ring[1:] + ring[:1], strict=True))
    walls = tuple(np.array([[*p, 0.0], [*q, 0.0], [*q, low], [*p, low]]) for p, q in pairs)
    facing = tuple(np.array([*((np.array(p) + np.array(q)) / 2), 0.0]) for p, q in pairs)
    shade = tuple(_tint(shape.colour, factor) for factor in (0.72, 0.6, 0.72, 0.6))
    patches = _roof_patches(shape)
    grown = np.array([(x * 1.06, y * 1.12) for x, y in ring])
    return Body(
        shadow=np.hstack([grown, np.full((4, 1), -shape.roof_m)]),
        walls=walls,
        facing=facing,
        wall_colour=shade,
        roof=tuple(np.hstack([flat, np.zeros((len(flat), 1))]) for flat, _ in patches),
        roof_colour=tuple(colour for _, colour in patches),
    )


def _roof_patches(shape: VehicleShape) -> list[tuple[Floats, tuple[int, int, int]]]:
    """The roof, a windscreen and a rear window, and a seeded pattern of panels that a tracker can hold on to."""
    rng = np.random.default_rng([shape.seed, 3])
    a, b = shape.length_m / 2, shape.width_m / 2

    def rectangle(back: float, front: float, right: float, left: float) -> Floats:
        return np.array([[front * a, left * b], [back * a, left * b], [back * a, right * b], [front * a, right * b]])

    patches = [(rectangle(-1, 1, -1, 1), shape.colour)]
    patches.append((rectangle(0.42, 0.66, -0.82, 0.82), GLASS))
    patches.append((rectangle(-0.92, -0.74, -0.78, 0.78), GLASS))
    for _ in range(4):
        back, right = rng.uniform(-0.7, 0.1), rng.uniform(-0.85, 0.1)
        piece = rectangle(back, back + rng.uniform(0.2, 0.45), right, right + rng.uniform(0.4, 0.7))
        light = rng.uniform(0.45, 0.75) if rng.random() < 0.5 else rng.uniform(1.25, 1.5)
        patches.append((piece, _tint(shape.colour, light)))
    return patches


def axes_of(target: SceneTarget, time_s: float) -> tuple[Floats, Floats]:
    """The reference point (3,) and enu_from_vehicle (3, 3) at a common time: level, heading where it drives."""
    at = np.array([time_s])
    forward = target.motion.position_enu_m(at, 1)[0] * np.array([1.0, 1.0, 0.0])
    forward /= np.linalg.norm(forward)
    left = np.array([-forward[1], forward[0], 0.0])
    return target.motion.position_enu_m(at)[0], np.stack([forward, left, [0.0, 0.0, 1.0]], axis=1)


def outline_enu_m(target: SceneTarget, time_s: float) -> Floats:
    """The roof's four corners (4, 3) at a common time."""
    if target.shape is None:
        raise ValueError(f"{target.name} has no shape")
    centre, enu_from_vehicle = axes_of(target, time_s)
    return np.asarray(centre + body(target.shape).roof[0] @ enu_from_vehicle.T)


def _tint(colour: tuple[int, int, int], factor: float) -> tuple[int, int, int]:
    blue, green, red = (int(np.clip(v * factor, 0, 255)) for v in colour)
    return blue, green, red
