"""Whether the videos were taken at one time, and whether fields of view ever meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, product

import numpy as np

from calibration.camera import CameraModel, unproject
from calibration.foundation.arrays import Floats, Ints
from pipeline.flight import Flight
from pipeline.geometry import rotation
from pipeline.stages.checks.doubt import Doubt
from pipeline.stages.checks.sights import SIGMAS, offset_between
from pipeline.stages.poses.measured import MeasuredPoses

CERTAIN_GAP_S = 60.0
"""Between two videos, beyond what their clocks are worth: nothing that one shows is in the other."""
VIEW_DEPTHS_M = tuple(np.geomspace(5.0, 3000.0, 14).tolist())
VIEW_MOMENTS = 24
"""Where fields of view are compared: so many moments of each video, so far ahead."""
VIEW_MARGIN = 0.15
"""Of the picture's side: what an attitude that is a little wrong may bring into view."""


def time_doubts(flight: Flight, measured: Sequence[MeasuredPoses]) -> list[Doubt]:
    """Videos that were not taken at one time."""
    found = []
    for one, other in combinations(measured, 2):
        between = offset_between(flight, one, other)
        if between is None or not (flight.camera(one.camera).video and flight.camera(other.camera).video):
            continue
        offset, sigma = between
        long = [len(m.poses.frame) / m.frame_rate for m in (one, other)]
        gap = max(offset - long[0], -offset - long[1])
        if gap <= SIGMAS * sigma:
            continue
        hours = round(gap / 3600)
        zone = hours >= 1 and abs(gap - hours * 3600) < max(long) + 120.0
        found.append(
            Doubt(
                kind="no-overlap",
                subject=(one.camera, other.camera),
                where=flight.key(other.camera, "start"),
                seen=f"the videos of {one.camera} and {other.camera} are {gap:.1f} s apart",
                expected="videos that show the same targets at the same time",
                advice="is one start in local time instead of UTC?" if zone else "look at start and offset_s of both",
                certain=gap > CERTAIN_GAP_S + 2 * SIGMAS * sigma,
            )
        )
    return found


def view_doubts(flight: Flight, measured: Sequence[MeasuredPoses], models: Mapping[str, CameraModel]) -> list[Doubt]:
    """Cameras whose field of view no other one's ever meets."""
    meets: dict[str, bool] = {}
    placed = [m for m in measured if all(models[m.camera].image_size)]
    for one, other in combinations(placed, 2):
        both = _views_meet(flight, one, other, models)
        for m in (one, other):
            meets[m.camera] = meets.get(m.camera, False) or both
    return [
        Doubt(
            kind="views-never-meet",
            subject=(name,),
            where=f"{flight.path}: cameras.{name}",
            seen="its field of view meets that of no other camera",
            expected="cameras that look at one place",
            advice="look at its mount, its log and its start",
        )
        for name, met in meets.items()
        if not met
    ]


def _views_meet(flight: Flight, one: MeasuredPoses, other: MeasuredPoses, models: Mapping[str, CameraModel]) -> bool:
    """Whether something before one camera comes into the other's picture, at the same time where that is known."""
    between = offset_between(flight, one, other)
    rows_a, rows_b = (_moments(m) for m in (one, other))
    width, height = models[one.camera].image_size
    pixels = np.array([[x * width, y * height] for x, y in product((0.1, 0.5, 0.9), repeat=2)])
    rays = unproject(models[one.camera], pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    turned = rotation.rotate(one.poses.enu_from_cam[rows_a][:, None], rays[None])
    depth = np.array(VIEW_DEPTHS_M)[None, None, :, None]
    points = one.poses.position_enu_m[rows_a][:, None, None] + depth * turned[:, :, None]
    for k, row in enumerate(rows_b):
        near = np.ones(len(rows_a), bool)
        if between is not None:
            times = rows_a / one.frame_rate - (row / other.frame_rate + between[0])
            step = max(len(m.poses.frame) / m.frame_rate / VIEW_MOMENTS for m in (one, other))
            near = np.abs(times) <= 2.0 + step + SIGMAS * between[1]
        if near.any() and _sees(models[other.camera], other, int(rows_b[k]), points[near].reshape(-1, 3)):
            return True
    return False


def _moments(measured: MeasuredPoses) -> Ints:
    """Rows (k,) of the moments at which views are compared."""
    count = len(measured.poses.frame)
    return np.unique(np.linspace(0, count - 1, min(count, VIEW_MOMENTS)).astype(np.int64))


def _sees(model: CameraModel, measured: MeasuredPoses, row: int, points_m: Floats) -> bool:
    """Whether one of the points (n, 3) is in the picture, lens left aside."""
    cam_from_enu = rotation.conjugate(measured.poses.enu_from_cam[row])
    x, y, z = rotation.rotate(cam_from_enu, points_m - measured.poses.position_enu_m[row]).T
    ahead = z > 1.0
    (fx, _, cx), (_, fy, cy), _ = model.K
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = fx * x / z + cx, fy * y / z + cy
    width, height = model.image_size
    inside = (np.abs(u / width - 0.5) < 0.5 + VIEW_MARGIN) & (np.abs(v / height - 0.5) < 0.5 + VIEW_MARGIN)
    return bool((ahead & inside).any())
