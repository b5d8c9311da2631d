"""trajectory.gpkg: a GeoPackage 1.3 (OGC 12-128r17) for QGIS, ArcGIS, GDAL: one file, two layers.

    positions  a point for each sample, with time, velocity and the sigma of its position
    paths      a line for each target and camera

Coordinates are longitude and latitude (EPSG:4326), heights are above the WGS84 ellipsoid. SQLite is what the format is
made of and what Python brings, so no further package is needed. Nothing in it tells when it was written.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

import numpy as np

from pipeline.export.text.cells import utc_texts
from pipeline.export.text.places import (
    ELLIPSOID,
    MapPath,
    camera_paths,
    geodetic_degrees,
    median_sigma_m,
    origin_of,
    target_paths,
)
from pipeline.export.text.well_known import well_known_line, well_known_points
from pipeline.records import Results, Trajectory

WGS84 = 4326
APPLICATION, VERSION = 0x47504B47, 10300
"""`GPKG`, and 1.3.0, as SQLite's header holds them."""
UNKNOWN_WRITTEN = "1970-01-01T00:00:00.000Z"
DEFINITION = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
TABLES = f"""
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
CREATE TABLE gpkg_spatial_ref_sys (
 srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
 organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
 table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
 last_change DATETIME NOT NULL DEFAULT (strftime('%Y-%m-%dT%H:%M:%fZ','now')), min_x DOUBLE, min_y DOUBLE,
 max_x DOUBLE, max_y DOUBLE, srs_id INTEGER,
 CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
 table_name TEXT NOT NULL, column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL,
 z TINYINT NOT NULL, m TINYINT NOT NULL, CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name),
 CONSTRAINT uk_gc_table_name UNIQUE (table_name),
 CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
 CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE positions (
 fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom POINT, target TEXT, time_s DOUBLE, utc DATETIME,
 east_m DOUBLE, north_m DOUBLE, up_m DOUBLE, ve_mps DOUBLE, vn_mps DOUBLE, vu_mps DOUBLE, sigma_m DOUBLE);
CREATE TABLE paths (
 fid INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, geom LINESTRING, name TEXT, kind TEXT, start_s DOUBLE, end_s DOUBLE,
 median_sigma_m DOUBLE, colour TEXT);
"""
LAYERS = (
    ("positions", "POINT", f"Where each target was; {ELLIPSOID}"),
    ("paths", "LINESTRING", f"The way of each target and camera; {ELLIPSOID}"),
)
SYSTEMS = (
    ("Undefined Cartesian SRS", -1, "NONE", -1, "undefined", "undefined Cartesian coordinate reference system"),
    ("Undefined geographic SRS", 0, "NONE", 0, "undefined", "undefined geographic coordinate reference system"),
    ("WGS 84 geodetic", WGS84, "EPSG", WGS84, DEFINITION, "longitude and latitude on WGS84"),
)


def geopackage(results: Results) -> bytes:
    """The flight as a GeoPackage; it must have an origin (ValueError)."""
    targets = [t for t in results.trajectories if len(t.time_s)]
    cameras = [path for path in camera_paths(results) if not path.still]
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as file:
        file.executescript(TABLES)
        file.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", SYSTEMS)
        for name, kind, words in LAYERS:
            file.execute(
                "INSERT INTO gpkg_contents VALUES (?, 'features', ?, ?, ?, ?, ?, ?, ?, ?)",
                (name, name, words, UNKNOWN_WRITTEN, *_extent(results, targets, cameras, name), WGS84),
            )
            file.execute("INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, 1, 0)", (name, kind, WGS84))
        for target in targets:
            file.executemany(_insert("positions", 11), _positions(results, target))
        file.executemany(_insert("paths", 7), _paths(results, targets, cameras))
        return file.serialize()


def _insert(table: str, columns: int) -> str:
    return f"INSERT INTO {table} VALUES (NULL, {', '.join('?' * columns)})"


def _extent(results: Results, targets: Sequence[Trajectory], cameras: Sequence[MapPath], layer: str) -> list[Any]:
    """West, south, east, north of a layer; None each where it is empty."""
    places = [geodetic_degrees(t.position_enu_m, origin_of(results))[:, :2] for t in targets]
    places += [path.place[:, :2] for path in cameras] if layer == "paths" else []
    every = np.concatenate([np.empty((0, 2)), *places])
    every = every[np.isfinite(every).all(axis=1)]
    return [*every.min(axis=0).tolist(), *every.max(axis=0).tolist()] if len(every) else [None] * 4


def _geometry(known: bytes) -> bytes:
    """Well-known binary behind a GeoPackage's header: little-endian, without an envelope."""
    return b"GP" + struct.pack("<BBi", 0, 1, WGS84) + known


def _positions(results: Results, of: Trajectory) -> Iterator[tuple[Any, ...]]:
    points = well_known_points(geodetic_degrees(of.position_enu_m, origin_of(results)))
    utc = [None] * len(of.time_s) if results.utc_s is None else _to_milliseconds(utc_texts(results.utc_s, of.time_s))
    figures = np.column_stack([of.position_enu_m, of.velocity_mps, of.sigma_m]).tolist()
    for point, time_s, when, row in zip(points, of.time_s.tolist(), utc, figures, strict=True):
        known = [value if np.isfinite(value) else None for value in row]
        yield (None if point is None else _geometry(point), of.target, time_s, when, *known)


def _to_milliseconds(texts: list[str]) -> list[str]:
    """The format's times have three decimals; `time_s` beside them is exact."""
    return [f"{text[:-4]}Z" for text in texts]


def _paths(results: Results, targets: Sequence[Trajectory], cameras: Sequence[MapPath]) -> Iterator[tuple[Any, ...]]:
    sigma = {t.target: median_sigma_m(t) for t in targets}
    ways = [("target", path) for path in target_paths(results)] + [("camera", path) for path in cameras]
    for kind, path in ways:
        known = path.place[np.isfinite(path.place).all(axis=1)]
        line = _geometry(well_known_line(known)) if len(known) > 1 else None
        times = float(path.time_s[0]), float(path.time_s[-1])
        yield line, path.name, kind, *times, sigma.get(path.name) if kind == "target" else None, f"#{path.colour}"
