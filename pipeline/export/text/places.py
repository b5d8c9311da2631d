"""What the map formats share: local metres as degrees, the cameras' paths, colours, and who stands still.

Heights are above the WGS84 ellipsoid throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.geometry.geodesy import Geodetic, geodetic_from_enu
from pipeline.records import PoseTrack, Results, Trajectory

CAMERA_SPACING_S = 0.2
STILL_M = 0.01
ELLIPSOID = "heights are above the WGS84 ellipsoid, not above mean sea level"
COLOURS = ("0072b2", "d55e00", "009e73", "cc79a7", "e69f00", "56b4e9", "f0e442")
"""rrggbb of targets in turn; told apart by the colour-blind too."""
CAMERA_COLOUR = "666666"


@dataclass(frozen=True, kw_only=True, eq=False)
class MapPath:
    """A path on the map.

    name      of the target or camera
    time_s    (n,) common time
    place     (n, 3) longitude and latitude in degrees (longitude from -180 to below 180), height in metres
    colour    rrggbb
    """

    name: str
    time_s: Floats
    place: Floats
    colour: str

    @property
    def still(self) -> bool:
        """Whether it is one place only."""
        return len(self.place) == 1


def geodetic_degrees(position_enu_m: Floats, origin: Geodetic) -> Floats:
    """Longitude, latitude in degrees and height (n, 3) of local metres (n, 3)."""
    lat, lon, height = geodetic_from_enu(position_enu_m, origin).T
    return np.column_stack([(np.degrees(lon) + 180) % 360 - 180, np.degrees(lat), height])


def origin_of(results: Results) -> Geodetic:
    """The origin of a flight that is on the map. Raises ValueError where it is not: a programmer's mistake."""
    if results.origin is None:
        raise ValueError("a flight without an origin is on no map")
    return results.origin


def target_paths(results: Results) -> tuple[MapPath, ...]:
    """The sampled trajectory of every target."""
    origin = origin_of(results)
    return tuple(
        MapPath(
            name=t.target,
            time_s=t.time_s,
            place=geodetic_degrees(t.position_enu_m, origin),
            colour=COLOURS[i % len(COLOURS)],
        )
        for i, t in enumerate(results.trajectories)
        if len(t.time_s)
    )


def camera_paths(results: Results) -> tuple[MapPath, ...]:
    """Every camera's refined path (measured where there is none), a position each 0.2 s; one where it stands still."""
    refined = {p.camera: p for p in results.solution.poses}
    chosen = {p.camera: p for p in results.measured_poses} | refined
    return tuple(_camera_path(poses, results) for poses in chosen.values() if len(poses.frame))


def _camera_path(poses: PoseTrack, results: Results) -> MapPath:
    clock = next((c for c in results.solution.clocks if c.camera == poses.camera), None)
    time_s = poses.time_s if clock is None else clock.common_time_s(poses.frame / clock.nominal_rate)
    rows = thinned(time_s, CAMERA_SPACING_S)
    if np.ptp(poses.position_enu_m, axis=0).max() < STILL_M:
        rows = rows[:1]
    place = geodetic_degrees(poses.position_enu_m[rows], origin_of(results))
    return MapPath(name=poses.camera, time_s=time_s[rows], place=place, colour=CAMERA_COLOUR)


def thinned(time_s: Floats, spacing_s: float) -> Ints:
    """The first row of every `spacing_s` of (n,) rising times, and the last row."""
    if len(time_s) == 0:
        return np.empty(0, np.int64)
    bin_ = np.floor((time_s - time_s[0]) / spacing_s + 1e-6).astype(np.int64)
    rows = np.flatnonzero(np.diff(bin_, prepend=-1) > 0)
    return rows if rows[-1] == len(time_s) - 1 else np.append(rows, len(time_s) - 1)


def median_sigma_m(trajectory: Trajectory) -> float | None:
    """The median one-sigma of the 3D position; None where it is not known."""
    sigma = trajectory.sigma_m
    return float(np.median(sigma)) if len(sigma) and np.isfinite(sigma).all() else None
