"""trajectory.czml: for Cesium, moving along a clock. Positions are longitude, latitude, height above the ellipsoid.

CZML knows no other time than UTC. Where none is known, common time 0 is shown as 2000-01-01T00:00:00Z, and the
document says so.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.export.as_json import dumps
from pipeline.export.text.cells import utc_texts
from pipeline.export.text.places import ELLIPSOID, MapPath, camera_paths, target_paths
from pipeline.records import Results

STAND_IN_UTC_S = 946684800.0
"""2000-01-01T00:00:00Z."""


def czml(results: Results) -> str:
    """The flight as a CZML document. It must have an origin (ValueError)."""
    utc_s = STAND_IN_UTC_S if results.utc_s is None else results.utc_s
    targets, cameras = target_paths(results), camera_paths(results)
    packets = [_document(results, utc_s, (*targets, *cameras))]
    packets += [_packet("target", path, utc_s, pixel_size=10, width=3) for path in targets]
    packets += [_packet("camera", path, utc_s, pixel_size=8, width=1) for path in cameras]
    return dumps(packets) + "\n"


def _document(results: Results, utc_s: float, paths: tuple[MapPath, ...]) -> dict[str, Any]:
    words = f"{ELLIPSOID[0].upper()}{ELLIPSOID[1:]}."
    if results.utc_s is None:
        words += " UTC is not known: 2000-01-01T00:00:00Z stands for common time 0."
    told: dict[str, Any] = {"id": "document", "name": results.title, "version": "1.0", "description": words}
    moving = [path for path in paths if not path.still]
    if moving:
        ends = np.array([min(p.time_s[0] for p in moving), max(p.time_s[-1] for p in moving)])
        start, end = utc_texts(utc_s, ends)
        told["clock"] = {
            "interval": f"{start}/{end}",
            "currentTime": start,
            "multiplier": 1,
            "range": "LOOP_STOP",
            "step": "SYSTEM_CLOCK_MULTIPLIER",
        }
    return told


def _packet(kind: str, path: MapPath, utc_s: float, *, pixel_size: int, width: int) -> dict[str, Any]:
    rgba = [*bytes.fromhex(path.colour), 255]
    told: dict[str, Any] = {
        "id": f"{kind}/{path.name}",
        "name": path.name,
        "position": {"cartographicDegrees": _degrees(path)},
        "point": {"color": {"rgba": rgba}, "pixelSize": pixel_size},
        "label": {"text": path.name, "font": "12pt sans-serif", "pixelOffset": {"cartesian2": [14, 0]}}
        | {"horizontalOrigin": "LEFT", "fillColor": {"rgba": rgba}},
    }
    if not path.still:
        epoch, start, end = utc_texts(utc_s, np.array([0.0, path.time_s[0], path.time_s[-1]]))
        told["availability"] = f"{start}/{end}"
        told["position"] = {
            "epoch": epoch,
            "interpolationAlgorithm": "LINEAR",
            "cartographicDegrees": _timed_degrees(path),
        }
        told["path"] = {"width": width, "material": {"solidColor": {"color": {"rgba": rgba}}}}
    return told


def _degrees(path: MapPath) -> list[float]:
    lon, lat, height = path.place[0].tolist()
    return [round(lon, 9), round(lat, 9), round(height, 4)]


def _timed_degrees(path: MapPath) -> list[float]:
    """Time since the epoch, longitude, latitude, height, and again."""
    columns = zip(path.time_s.tolist(), *path.place.T.tolist(), strict=True)
    rows = ((round(t, 6), round(lon, 9), round(lat, 9), round(height, 4)) for t, lon, lat, height in columns)
    return [value for row in rows for value in row]
