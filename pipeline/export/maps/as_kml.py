"""trajectory.kml: KML 2.2 for Google Earth; with a time slider (gx:Track) where UTC is known.

KML counts altitudes from mean sea level (EGM96), ours count from the WGS84 ellipsoid, and between the two lies the
height of the geoid: -106 to 85 m, about 0.1 m across one flight. `geoid_height_m` is taken off. It is not known here
unless the caller tells, so every target has two drawings: one in space (absolute), as computed, and its shadow on
the terrain (clampToGround), which is right on the map whatever the datum.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from pipeline.export.text.cells import fixed, utc_texts
from pipeline.export.text.places import CAMERA_COLOUR, MapPath, camera_paths, median_sigma_m, target_paths
from pipeline.export.text.xml_text import child, document
from pipeline.records import Results


def kml(results: Results, geoid_height_m: float = 0.0) -> str:
    """The flight as KML; it must have an origin (ValueError). `geoid_height_m`: of EGM96 above the ellipsoid there."""
    targets, cameras = target_paths(results), camera_paths(results)
    root = ET.Element(
        "kml", {"xmlns": "http://www.opengis.net/kml/2.2", "xmlns:gx": "http://www.google.com/kml/ext/2.2"}
    )
    top = child(root, "Document")
    child(top, "name", results.title)
    child(top, "description", _about(geoid_height_m))
    for i, path in enumerate(targets):
        _style(top, f"target{i}", path.colour, width=4)
    _style(top, "camera", CAMERA_COLOUR, width=2)
    folder = _folder(top, "Targets in space")
    sigma_m = {t.target: median_sigma_m(t) for t in results.trajectories}
    for i, path in enumerate(targets):
        facts = {"start_s": fixed(path.time_s[0], 3), "end_s": fixed(path.time_s[-1], 3)}
        known = sigma_m[path.name]
        if known is not None:
            facts["median_sigma_m"] = fixed(known, 3)
        _in_space(_placemark(folder, path.name, f"target{i}", facts), path, results.utc_s, geoid_height_m)
    folder = _folder(top, "Targets on the ground")
    for i, path in enumerate(targets):
        _geometry(_placemark(folder, path.name, f"target{i}", {}), path, 0.0, "clampToGround")
    folder = _folder(top, "Cameras")
    for path in cameras:
        _in_space(_placemark(folder, path.name, "camera", {}), path, results.utc_s, geoid_height_m)
    return document(root)


def _about(geoid_height_m: float) -> str:
    if geoid_height_m == 0.0:
        return (
            "Altitudes here are heights above the WGS84 ellipsoid. Viewers take them for heights above mean sea level, "
            "so in space everything is drawn too high by the height of the geoid (-106 to 85 m, the same for the whole "
            "flight). The drawings on the ground are not affected."
        )
    return (
        "Altitudes are above mean sea level: heights above the WGS84 ellipsoid less a geoid height of "
        f"{fixed(geoid_height_m, 2)} m for the whole flight."
    )


def _style(parent: ET.Element, name: str, rrggbb: str, *, width: int) -> None:
    style = child(parent, "Style", id=name)
    aabbggrr = f"ff{rrggbb[4:6]}{rrggbb[2:4]}{rrggbb[0:2]}"
    child(child(style, "IconStyle"), "color", aabbggrr)
    line = child(style, "LineStyle")
    child(line, "color", aabbggrr)
    child(line, "width", str(width))


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = child(parent, "Folder")
    child(folder, "name", name)
    return folder


def _placemark(folder: ET.Element, name: str, style: str, facts: dict[str, str]) -> ET.Element:
    placemark = child(folder, "Placemark")
    child(placemark, "name", name)
    child(placemark, "styleUrl", f"#{style}")
    if facts:
        extended = child(placemark, "ExtendedData")
        for key, value in facts.items():
            child(child(extended, "Data", name=key), "value", value)
    return placemark


def _in_space(placemark: ET.Element, path: MapPath, utc_s: float | None, geoid_height_m: float) -> None:
    if utc_s is None or path.still:
        _geometry(placemark, path, geoid_height_m, "absolute")
        return
    track = child(placemark, "gx:Track")
    child(track, "altitudeMode", "absolute")
    for when in utc_texts(utc_s, path.time_s):
        child(track, "when", when)
    for words in _coordinates(path, geoid_height_m):
        child(track, "gx:coord", " ".join(words))


def _geometry(placemark: ET.Element, path: MapPath, geoid_height_m: float, mode: str) -> None:
    shape = child(placemark, "Point" if path.still else "LineString")
    if mode == "clampToGround" and not path.still:
        child(shape, "tessellate", "1")
    child(shape, "altitudeMode", mode)
    child(shape, "coordinates", " ".join(",".join(words) for words in _coordinates(path, geoid_height_m)))


def _coordinates(path: MapPath, geoid_height_m: float) -> list[tuple[str, str, str]]:
    altitude = path.place - np.array([0.0, 0.0, geoid_height_m])
    return [(fixed(lon, 9), fixed(lat, 9), fixed(height, 3)) for lon, lat, height in altitude.tolist()]
