"""Flights whose cameras swing and are read out row by row, drawn with nothing of the project.

A row is exposed when it is read: the time at which a point is seen follows from the row where it is seen, and the row
from the time. The fixed point is found by repeating, which converges by the picture's motion in a readout over its
height.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scripts.validation.drawn_flights import Camera, Flight, draw, measure

SWING_DEG_S = 20.0
"""Root mean square of the turning."""
REPEATED = 12


def swinging(rng, path):
    """The path of a camera that turns right and left, and a little up and down, while it follows it."""
    period_s, phase = rng.uniform(1.6, 3.0, 2), rng.uniform(0, 2 * np.pi, 2)
    share = np.array([0.9, np.sqrt(1 - 0.81)])
    size = np.radians(SWING_DEG_S) * np.sqrt(2) * share * period_s / (2 * np.pi)

    def pose(t):
        place, attitude = path(t)
        angle = size * np.sin(2 * np.pi * np.asarray(t)[:, None] / period_s + phase)
        return place, attitude * Rotation.from_euler("yx", angle)

    return pose


def rows_seen(cam: Camera, where, readout_s: float):
    """Pixels (n, 2) of a motion at the instants of their rows; NaN behind the camera.

    The frame's time is that of its middle row; `readout_s` lasts from the first row to the last.
    """
    t = cam.begin_s + np.arange(cam.frames) / cam.rate_hz
    middle, late = (np.array(cam.size) - 1) / 2, np.zeros(cam.frames)
    for _ in range(REPEATED):
        place, attitude = cam.path(t + late)
        y = attitude.inv().apply(where(t + late) - place)
        y[y[:, 2] < 1] = np.nan
        xy = cam.focal_px * y[:, :2] / y[:, 2:] + middle
        late = readout_s * np.nan_to_num(xy[:, 1] / (cam.size[1] - 1) - 0.5)
    return xy


def shuttered(seed: int, readout_s: float, *, grade: str = "good", targets: int = 4, length_s: float = 12.0) -> Flight:
    """A flight of two cameras; all of a seed but for what the readout does is the same, noise too."""
    flight = draw(seed, cameras=2, targets=targets, length_s=length_s, grade=grade)
    rng = np.random.default_rng([seed, 77])
    for cam in flight.cameras:
        cam.path = swinging(rng, cam.path)
        cam.position_m, cam.enu_from_cam = cam.path(cam.begin_s + np.arange(cam.frames) / cam.rate_hz)
        cam.told, cam.tracks = {}, {}
        measure(rng, cam, False)
        for name, where in flight.motions.items():
            noise = rng.normal(0, cam.grade[4], (cam.frames, 2))
            still, xy = rows_seen(cam, where, 0.0), rows_seen(cam, where, readout_s)
            inside = ((still > 30) & (still < np.array(cam.size) - 30)).all(1) & np.isfinite(xy).all(1)
            if inside.sum() > 40:
                cam.tracks[name] = (np.flatnonzero(inside), xy[inside] + noise[inside])
    seen = {name: sum(name in cam.tracks for cam in flight.cameras) for name in flight.motions}
    for cam in flight.cameras:
        cam.tracks = {name: track for name, track in cam.tracks.items() if seen[name] > 1}
    flight.motions = {name: where for name, where in flight.motions.items() if seen[name] > 1}
    second = flight.cameras[1]
    second.told["offset_s"], second.told_sigma["offset_s"] = round(second.begin_s, 2), 0.05
    return flight
