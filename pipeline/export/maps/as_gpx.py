"""trajectory.gpx: GPX 1.1, a track for each target, for GPS tools. Times only where UTC is known.

GPX leaves the datum of elevations open and most tools take them for heights above mean sea level. Ours are above the
WGS84 ellipsoid; the file says so.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from pipeline.export.text.cells import fixed, utc_texts
from pipeline.export.text.places import ELLIPSOID, MapPath, target_paths
from pipeline.export.text.xml_text import child, document
from pipeline.records import Results


def gpx(results: Results) -> str:
    """The targets as GPX. The flight must have an origin (ValueError)."""
    root = ET.Element("gpx", {"version": "1.1", "creator": "runningfix", "xmlns": "http://www.topografix.com/GPX/1/1"})
    metadata = child(root, "metadata")
    child(metadata, "name", results.title)
    child(metadata, "desc", f"Elevations: {ELLIPSOID}.")
    for path in target_paths(results):
        _track(root, path, results)
    return document(root)


def _track(root: ET.Element, path: MapPath, results: Results) -> None:
    track = child(root, "trk")
    child(track, "name", path.name)
    child(track, "src", f"cameras, method {results.solution.method}")
    segment = child(track, "trkseg")
    times = None if results.utc_s is None else utc_texts(results.utc_s, path.time_s)
    for i, (lon, lat, height) in enumerate(path.place.tolist()):
        point = child(segment, "trkpt", lat=fixed(lat, 9), lon=_below_180(fixed(lon, 9)))
        child(point, "ele", fixed(height, 3))
        if times is not None:
            child(point, "time", times[i])


def _below_180(lon: str) -> str:
    """GPX has no longitude of +180."""
    return "-180.000000000" if lon == "180.000000000" else lon
