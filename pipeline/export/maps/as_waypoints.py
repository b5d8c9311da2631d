"""trajectory.waypoints: QGC WPL 110, the mission file of MAVLink's ground stations (Mission Planner, QGroundControl).

One target per file, as with the TUM format. Row 0 is home, the flight's origin; the others are waypoints whose heights
count from home (frame 3), so that no datum of the autopilot's matters. Made to look at or to follow a target's way at
a height that a person chooses: flown as it is, it is as high as the target.
"""

from __future__ import annotations

import numpy as np

from pipeline.export.text.cells import fixed
from pipeline.export.text.file_names import names_of_others
from pipeline.export.text.places import geodetic_degrees, origin_of, thinned
from pipeline.records import Results, Trajectory

SPACING_S, MOST = 1.0, 600
"""Between waypoints at least, and their number at most: autopilots take some 700."""
WAYPOINT, FROM_SEA, FROM_HOME = 16, 0, 3
"""MAV_CMD_NAV_WAYPOINT, MAV_FRAME_GLOBAL, MAV_FRAME_GLOBAL_RELATIVE_ALT."""


def waypoints(results: Results) -> str | None:
    """The first target's way; None where there is no target. The flight must have an origin (ValueError)."""
    return _mission(results, results.trajectories[0]) if results.trajectories else None


def waypoints_of_others(results: Results) -> dict[str, str]:
    """File name -> text of every target but the first."""
    return {name: _mission(results, t) for name, t in names_of_others(results.trajectories, "waypoints").items()}


def _mission(results: Results, of: Trajectory) -> str:
    known = np.flatnonzero(np.isfinite(of.position_enu_m).all(axis=1))
    time = of.time_s[known]
    long_s = float(time[-1] - time[0]) if len(time) else 0.0
    rows = known[thinned(time, max(SPACING_S, long_s / MOST))]
    origin = origin_of(results)
    home = (float(np.degrees(origin.lon_rad)), float(np.degrees(origin.lat_rad)), origin.height_m)
    lines = ["QGC WPL 110", _row(0, FROM_SEA, home)]
    for number, (lon, lat, height) in enumerate(geodetic_degrees(of.position_enu_m[rows], origin).tolist(), start=1):
        lines.append(_row(number, FROM_HOME, (lon, lat, height - origin.height_m)))
    return "\n".join(lines) + "\n"


def _row(number: int, frame: int, place: tuple[float, float, float]) -> str:
    lon, lat, height = place
    cells = [number, int(number == 0), frame, WAYPOINT, 0, 0, 0, 0, fixed(lat, 10), fixed(lon, 10), fixed(height, 4), 1]
    return "\t".join(map(str, cells))
