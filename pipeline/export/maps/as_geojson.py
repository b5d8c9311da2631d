"""trajectory.geojson: RFC 7946, for QGIS and web maps. Positions are longitude, latitude, height above the ellipsoid.

Each target is a line, and a point every second that carries time and sigmas; each camera is a line, or a point where
it stands still. A line that crosses the antimeridian is cut there in two (RFC 7946 section 3.1.9).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.export.as_json import dumps
from pipeline.export.text.cells import utc_texts
from pipeline.export.text.places import (
    ELLIPSOID,
    MapPath,
    camera_paths,
    geodetic_degrees,
    median_sigma_m,
    origin_of,
    target_paths,
    thinned,
)
from pipeline.records import Results, Trajectory

POINT_SPACING_S = 1.0


def geojson(results: Results) -> str:
    """The flight as a FeatureCollection. The flight must have an origin (ValueError)."""
    sampled = {t.target: t for t in results.trajectories}
    features: list[dict[str, Any]] = []
    for path in target_paths(results):
        features.append(_target(path, sampled[path.name], results))
    for path in camera_paths(results):
        times = {} if path.still else _times(path.time_s, results.utc_s)
        features.append(_feature(line_or_point(path.place), {"kind": "camera", "name": path.name} | times))
    for path in target_paths(results):
        features.extend(_points(sampled[path.name], results))
    collection: dict[str, Any] = {"type": "FeatureCollection", "title": results.title, "heights": ELLIPSOID}
    return dumps(collection | {"features": features}) + "\n"


def line_or_point(place: Floats) -> dict[str, Any]:
    """The geometry of (n, 3) longitudes, latitudes, heights: Point, LineString, or MultiLineString where it was cut."""
    if len(place) == 1:
        return {"type": "Point", "coordinates": _coordinates(place)[0]}
    parts = [_coordinates(part) for part in cut_at_antimeridian(place)]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def cut_at_antimeridian(place: Floats) -> list[Floats]:
    """The parts of a line (n, 3) that lie on one side each; both sides get the crossing itself, at +-180 degrees.

    A step of more than 180 degrees of longitude goes the short way round, over the antimeridian.
    """
    parts: list[Floats] = []
    rest = np.array(place, float)
    for row in _crossings(place)[::-1]:
        here, there = rest[row], rest[row + 1]
        side = 180.0 if here[0] > 0 else -180.0
        gap = there[0] + 2 * side - here[0]
        share = (side - here[0]) / gap if gap else 0.0
        crossing = np.array([side, *(here[1:] + share * (there[1:] - here[1:]))])
        parts.append(np.vstack([crossing * [-1, 1, 1], rest[row + 1 :]]))
        rest = np.vstack([rest[: row + 1], crossing])
    return [_at_least_two(part) for part in [rest, *parts[::-1]]]


def _crossings(place: Floats) -> Ints:
    return np.flatnonzero(np.abs(np.diff(place[:, 0])) > 180)


def _at_least_two(part: Floats) -> Floats:
    return part if len(part) > 1 else np.vstack([part, part])


def _coordinates(place: Floats) -> list[list[float]]:
    return [[round(lon, 9) + 0.0, round(lat, 9) + 0.0, round(height, 4) + 0.0] for lon, lat, height in place.tolist()]


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _target(path: MapPath, trajectory: Trajectory, results: Results) -> dict[str, Any]:
    steps = np.diff(trajectory.position_enu_m, axis=0)
    sigma_m = median_sigma_m(trajectory)
    figures = {
        "length_m": round(float(np.linalg.norm(steps, axis=1).sum()), 3),
        "median_speed_mps": round(float(np.median(np.linalg.norm(trajectory.velocity_mps, axis=1))), 3),
        "median_sigma_m": None if sigma_m is None else round(sigma_m, 4),
        "stroke": f"#{path.colour}",
    }
    told = {"kind": "target", "name": path.name} | _times(path.time_s, results.utc_s) | figures
    return _feature(line_or_point(path.place), told)


def _times(time_s: Floats, utc_s: float | None) -> dict[str, Any]:
    ends = time_s[[0, -1]]
    utc = [None, None] if utc_s is None else utc_texts(utc_s, ends)
    start_s, end_s = np.round(ends, 6).tolist()
    return {"start_s": start_s, "end_s": end_s, "utc_start": utc[0], "utc_end": utc[1]}


def _points(trajectory: Trajectory, results: Results) -> list[dict[str, Any]]:
    rows = thinned(trajectory.time_s, POINT_SPACING_S)
    time_s = trajectory.time_s[rows]
    utc = [None] * len(rows) if results.utc_s is None else utc_texts(results.utc_s, time_s)
    sigma = np.sqrt(np.diagonal(trajectory.covariance[rows], axis1=1, axis2=2))
    place = geodetic_degrees(trajectory.position_enu_m[rows], origin_of(results))
    features = []
    for i in range(len(rows)):
        east, north, up = np.round(sigma[i], 4).tolist()
        told = {
            "kind": "position",
            "name": trajectory.target,
            "time_s": round(float(time_s[i]), 6),
            "utc": utc[i],
            "sigma_east_m": east,
            "sigma_north_m": north,
            "sigma_up_m": up,
        }
        features.append(_feature(line_or_point(place[i : i + 1]), told))
    return features
