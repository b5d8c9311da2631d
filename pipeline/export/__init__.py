"""Results become files: tables, solution.json, and maps for QGIS, Google Earth, Cesium, GPS tools and evo.

Each format is one module with one pure function from `Results` to text; `EXPORTS` lists them with their file names,
and `write_exports` is the edge. The tables that later stages read back (tracks.csv, poses.csv) hold exact floats.
Heights on the map are above the WGS84 ellipsoid; a format whose readers expect mean sea level says so inside.
"""

from pipeline.export.as_json import solution_json
from pipeline.export.as_tum import tum, tum_of_others
from pipeline.export.exporters import EXPORTS, Exporter, export_all, not_exported, write_exports
from pipeline.export.maps.as_czml import czml
from pipeline.export.maps.as_geojson import geojson
from pipeline.export.maps.as_geopackage import geopackage
from pipeline.export.maps.as_gpx import gpx
from pipeline.export.maps.as_kml import kml
from pipeline.export.maps.as_waypoints import waypoints
from pipeline.export.tables.as_geoparquet import geoparquet, parquet_bytes, parquet_of
from pipeline.export.tables.as_poses import poses_csv, read_poses_csv
from pipeline.export.tables.as_tables import clock_csv, sightings_csv, timing_csv, trajectory_csv
from pipeline.export.tables.as_tracks import read_tracks_csv, tracks_csv
from pipeline.export.tables.detections import read_detections_csv

__all__ = [
    "EXPORTS",
    "Exporter",
    "clock_csv",
    "czml",
    "export_all",
    "geojson",
    "geopackage",
    "geoparquet",
    "gpx",
    "kml",
    "not_exported",
    "parquet_bytes",
    "parquet_of",
    "poses_csv",
    "read_detections_csv",
    "read_poses_csv",
    "read_tracks_csv",
    "sightings_csv",
    "solution_json",
    "timing_csv",
    "tracks_csv",
    "trajectory_csv",
    "tum",
    "tum_of_others",
    "waypoints",
    "write_exports",
]
