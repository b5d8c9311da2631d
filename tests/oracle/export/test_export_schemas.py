"""The map formats against the rules of their standards.

GeoJSON: RFC 7946 as a JSON schema. CZML: the packets we use, from the CZML guide, as a JSON schema. KML 2.2 (OGC
07-147r2, with Google's gx:Track) and GPX 1.1: which elements may be where, in which order, holding what. Where the
published XML schema of KML is at hand (fastkml brings it), that decides too.
"""

from __future__ import annotations

import io
import json
import re
import xml.etree.ElementTree as ET
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from pipeline.export import export_all, kml
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Results
from tests.scenes.export import tiny_results

FLIGHTS: dict[str, Results] = {
    "usual": tiny_results(),
    "no UTC": tiny_results(utc_s=None),
    "antimeridian": tiny_results(origin=Geodetic.from_degrees(-17.0, 179.9998, 5.0)),
    "far south": tiny_results(origin=Geodetic.from_degrees(-89.99, -120.0, -30.0)),
    "no target": tiny_results(trajectories=()),
}
flight = pytest.mark.parametrize("results", FLIGHTS.values(), ids=FLIGHTS.keys())

POSITION = {
    "type": "array",
    "minItems": 2,
    "maxItems": 3,
    "prefixItems": [
        {"type": "number", "minimum": -180, "maximum": 180},
        {"type": "number", "minimum": -90, "maximum": 90},
    ],
    "items": {"type": "number"},
}
LINE = {"type": "array", "minItems": 2, "items": POSITION}


def shape(name: str, coordinates: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["type", "coordinates"],
        "properties": {"type": {"const": name}, "coordinates": coordinates},
        "not": {"anyOf": [{"required": [taken]} for taken in ("geometry", "properties", "features")]},
    }


GEOJSON = {
    "type": "object",
    "required": ["type", "features"],
    "not": {
        "anyOf": [{"required": [taken]} for taken in ("coordinates", "geometries", "geometry", "properties", "crs")]
    },
    "properties": {
        "type": {"const": "FeatureCollection"},
        "features": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["type", "geometry", "properties"],
                "not": {"anyOf": [{"required": [taken]} for taken in ("coordinates", "geometries", "features")]},
                "properties": {
                    "type": {"const": "Feature"},
                    "properties": {"type": ["object", "null"]},
                    "geometry": {
                        "oneOf": [
                            shape("Point", POSITION),
                            shape("LineString", LINE),
                            shape("MultiLineString", {"type": "array", "items": LINE}),
                        ]
                    },
                },
            },
        },
    },
}

UTC = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z"
INTERVAL = {"type": "string", "pattern": f"^{UTC}/{UTC}$"}
COLOUR = {
    "type": "object",
    "required": ["rgba"],
    "properties": {
        "rgba": {
            "type": "array",
            "minItems": 4,
            "maxItems": 4,
            "items": {"type": "integer", "minimum": 0, "maximum": 255},
        }
    },
}
CZML = {
    "type": "array",
    "minItems": 1,
    "prefixItems": [
        {
            "type": "object",
            "required": ["id", "version"],
            "additionalProperties": False,
            "properties": {
                "id": {"const": "document"},
                "version": {"const": "1.0"},
                "name": {"type": "string"},
                "description": {"type": "string"},
                "clock": {
                    "type": "object",
                    "additionalProperties": False,
                    "properties": {
                        "interval": INTERVAL,
                        "currentTime": {"type": "string", "pattern": f"^{UTC}$"},
                        "multiplier": {"type": "number"},
                        "range": {"enum": ["UNBOUNDED", "CLAMPED", "LOOP_STOP"]},
                        "step": {"enum": ["SYSTEM_CLOCK", "SYSTEM_CLOCK_MULTIPLIER", "TICK_DEPENDENT"]},
                    },
                },
            },
        }
    ],
    "items": {
        "type": "object",
        "required": ["id", "position"],
        "additionalProperties": False,
        "properties": {
            "id": {"type": "string"},
            "name": {"type": "string"},
            "availability": INTERVAL,
            "position": {
                "type": "object",
                "required": ["cartographicDegrees"],
                "additionalProperties": False,
                "properties": {
                    "epoch": {"type": "string", "pattern": f"^{UTC}$"},
                    "interpolationAlgorithm": {"enum": ["LINEAR", "LAGRANGE", "HERMITE"]},
                    "cartographicDegrees": {"type": "array", "minItems": 3, "items": {"type": "number"}},
                },
            },
            "point": {
                "type": "object",
                "additionalProperties": False,
                "properties": {"color": COLOUR, "pixelSize": {"type": "number"}},
            },
            "path": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "width": {"type": "number"},
                    "material": {
                        "type": "object",
                        "required": ["solidColor"],
                        "properties": {"solidColor": {"type": "object", "properties": {"color": COLOUR}}},
                    },
                },
            },
            "label": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "text": {"type": "string"},
                    "font": {"type": "string"},
                    "pixelOffset": {"type": "object", "required": ["cartesian2"]},
                    "horizontalOrigin": {"enum": ["LEFT", "CENTER", "RIGHT"]},
                    "fillColor": COLOUR,
                },
            },
        },
    },
}

NUMBER = r"-?\d+(\.\d+)?"
ANY = r"[\s\S]*"
NAMES = {"http://www.opengis.net/kml/2.2": "", "http://www.google.com/kml/ext/2.2": "gx:"}
FEATURE = ("name", "description", "styleUrl", "Style*", "ExtendedData")
KML_RULES: dict[str, tuple[tuple[str, ...], str | None, dict[str, str]]] = {
    # element: (its children in order, * where many), what its text matches, its attributes
    "kml": (("Document",), None, {}),
    "Document": ((*FEATURE, "Folder*"), None, {}),
    "Folder": ((*FEATURE, "Placemark*"), None, {}),
    "Placemark": ((*FEATURE, "Point", "LineString", "gx:Track"), None, {}),
    "Style": (("IconStyle", "LineStyle"), None, {"id": r"[\w-]+"}),
    "IconStyle": (("color",), None, {}),
    "LineStyle": (("color", "width"), None, {}),
    "ExtendedData": (("Data*",), None, {}),
    "Data": (("value",), None, {"name": r"\w+"}),
    "Point": (("altitudeMode", "coordinates"), None, {}),
    "LineString": (("tessellate", "altitudeMode", "coordinates"), None, {}),
    "gx:Track": (("altitudeMode", "when*", "gx:coord*"), None, {}),
    "altitudeMode": ((), "clampToGround|relativeToGround|absolute", {}),
    "tessellate": ((), "[01]", {}),
    "coordinates": ((), rf"{NUMBER},{NUMBER},{NUMBER}( {NUMBER},{NUMBER},{NUMBER})*", {}),
    "gx:coord": ((), rf"{NUMBER} {NUMBER} {NUMBER}", {}),
    "when": ((), UTC, {}),
    "color": ((), "[0-9a-f]{8}", {}),
    "width": ((), NUMBER, {}),
    "styleUrl": ((), r"#[\w-]+", {}),
    "name": ((), ANY, {}),
    "description": ((), ANY, {}),
    "value": ((), ANY, {}),
}
LATITUDE = r"-?(90(\.0+)?|[0-8]?\d(\.\d+)?)"
LONGITUDE = r"-180(\.0+)?|-?(1[0-7]\d|\d?\d)(\.\d+)?"
GPX_RULES: dict[str, tuple[tuple[str, ...], str | None, dict[str, str]]] = {
    "gpx": (("metadata", "trk*"), None, {"version": r"1\.1", "creator": r".+"}),
    "metadata": (("name", "desc"), None, {}),
    "trk": (("name", "src", "trkseg*"), None, {}),
    "trkseg": (("trkpt*",), None, {}),
    "trkpt": (("ele", "time"), None, {"lat": LATITUDE, "lon": LONGITUDE}),
    "ele": ((), NUMBER, {}),
    "time": ((), UTC, {}),
    "name": ((), ANY, {}),
    "desc": ((), ANY, {}),
    "src": ((), ANY, {}),
}


def check_element(element: ET.Element, rules: dict[str, Any], names: dict[str, str]) -> None:
    """Assert that an element and all below it follow the rules."""
    tag = short(element.tag, names)
    children, text, attributes = rules[tag]
    places = {child.rstrip("*"): place for place, child in enumerate(children)}
    there = [short(child.tag, names) for child in element]
    assert set(there) <= set(places), f"{tag} holds {there}"
    order = [places[child] for child in there]
    assert order == sorted(order), f"{tag}: {there} out of order"
    single = [child for child in there if f"{child}*" not in children]
    assert len(single) == len(set(single)), f"{tag}: {single} more than once"
    assert set(element.attrib) == set(attributes)
    for name, pattern in attributes.items():
        assert re.fullmatch(pattern, element.attrib[name]), f"{tag} {name}={element.attrib[name]}"
    if text is None:
        assert not (element.text or "").strip()
    else:
        assert re.fullmatch(text, element.text or ""), f"{tag}: {element.text}"
    for child in element:
        check_element(child, rules, names)


def short(tag: str, names: dict[str, str]) -> str:
    space, name = tag[1:].split("}")
    return names[space] + name


@flight
def test_geojson_follows_rfc_7946(results: Results) -> None:
    jsonschema.Draft202012Validator(GEOJSON).validate(json.loads(export_all(results)["trajectory.geojson"]))


@flight
def test_no_geojson_line_crosses_the_antimeridian(results: Results) -> None:
    for feature in json.loads(export_all(results)["trajectory.geojson"])["features"]:
        geometry = feature["geometry"]
        lines = {"Point": [], "LineString": [geometry["coordinates"]], "MultiLineString": geometry["coordinates"]}
        for line in lines[geometry["type"]]:
            assert np.abs(np.diff([place[0] for place in line])).max() < 180


@flight
def test_czml_follows_its_guide(results: Results) -> None:
    packets = json.loads(export_all(results)["trajectory.czml"])
    jsonschema.Draft202012Validator(CZML).validate(packets)
    assert len({packet["id"] for packet in packets}) == len(packets)
    for packet in packets[1:]:
        values, moving = packet["position"]["cartographicDegrees"], "epoch" in packet["position"]
        assert len(values) % (4 if moving else 3) == 0
        if moving:
            assert (np.diff(values[::4]) > 0).all()


@flight
def test_kml_follows_ogc_07_147r2(results: Results) -> None:
    for text in (export_all(results)["trajectory.kml"], kml(results, geoid_height_m=-31.25)):
        root = ET.fromstring(text)
        check_element(root, KML_RULES, NAMES)
        styles = {f"#{style.get('id')}" for style in root.iter("{http://www.opengis.net/kml/2.2}Style")}
        assert {e.text for e in root.iter("{http://www.opengis.net/kml/2.2}styleUrl")} <= styles
        for track in root.iter("{http://www.google.com/kml/ext/2.2}Track"):
            tags = [short(child.tag, NAMES) for child in track]
            assert tags.count("when") == tags.count("gx:coord") > 0


@flight
def test_gpx_follows_1_1(results: Results) -> None:
    root = ET.fromstring(export_all(results)["trajectory.gpx"])
    check_element(root, GPX_RULES, {"http://www.topografix.com/GPX/1/1": ""})


@flight
@pytest.mark.skipif(find_spec("fastkml") is None, reason="the published KML schema comes with fastkml")
def test_kml_follows_the_published_schema(results: Results) -> None:
    etree = pytest.importorskip("lxml.etree")
    spec = find_spec("fastkml")
    assert spec is not None
    assert spec.origin is not None
    schema = etree.XMLSchema(etree.parse(str(Path(spec.origin).parent / "schema" / "ogckml22.xsd")))
    schema.assertValid(etree.fromstring(export_all(results)["trajectory.kml"].encode()))


@pytest.mark.parametrize("results", [r for r in FLIGHTS.values() if r.trajectories], ids=range(4))
def test_tum_is_what_evo_reads(results: Results) -> None:
    """Evo drops lines that begin with #, splits at single spaces, wants 8 numbers, rising times, unit quaternions."""
    for name, text in export_all(results).items():
        if name.endswith(".tum"):
            rows = [line.split(" ") for line in text.splitlines() if not line.startswith("#")]
            assert all(len(row) == 8 for row in rows)
            table = np.array(rows).astype(float)
            np.testing.assert_array_equal(table, np.loadtxt(io.StringIO(text), ndmin=2))
            assert (np.diff(table[:, 0]) > 0).all()
            np.testing.assert_array_equal(np.linalg.norm(table[:, 4:], axis=1), 1.0)
            assert text.endswith("0 0 0 1\n")
