"""GeoPackage, GeoParquet and MAVLink missions by readers that others wrote: positions are equal to 1 mm."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.export import export_all
from pipeline.export.maps.as_waypoints import MOST
from pipeline.records import Results
from tests.scenes.export import BUS, ORIGIN, VAN, tiny_results

geopandas = pytest.importorskip("geopandas")
pyproj = pytest.importorskip("pyproj")
MILLIMETRE = 1e-3


def enu_m(place: np.ndarray) -> np.ndarray:
    """Local metres (n, 3) of longitude, latitude, height (n, 3), by PROJ."""
    lat, lon = np.degrees(ORIGIN.lat_rad), np.degrees(ORIGIN.lon_rad)
    steps = "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84"
    moved = pyproj.Transformer.from_pipeline(f"{steps} +lon_0={lon} +lat_0={lat} +h_0={ORIGIN.height_m}")
    return np.column_stack(moved.transform(*place.T))


def points_of(frame) -> np.ndarray:
    return np.array([[p.x, p.y, p.z] for p in frame.geometry])


def written(tmp_path: Path, results: Results) -> Path:
    for name, content in export_all(results).items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return tmp_path


@pytest.fixture(scope="module")
def results() -> Results:
    return tiny_results()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, results: Results) -> Path:
    return written(tmp_path_factory.mktemp("exports"), results)


def test_gdal_reads_the_points_of_the_geopackage(folder, results):
    frame = geopandas.read_file(folder / "trajectory.gpkg", layer="positions")
    assert frame.crs.to_epsg() == 4326
    assert set(frame.geom_type) == {"Point"}
    for t in results.trajectories:
        own = frame[frame.target == t.target]
        np.testing.assert_allclose(enu_m(points_of(own)), t.position_enu_m, atol=MILLIMETRE)
        np.testing.assert_allclose(own[["east_m", "north_m", "up_m"]], t.position_enu_m, atol=1e-9)
        np.testing.assert_allclose(own.time_s, t.time_s)
        np.testing.assert_allclose(own.sigma_m.to_numpy(float), t.sigma_m)
        seconds = (own.utc - own.utc.iloc[0]).dt.total_seconds()
        np.testing.assert_allclose(seconds, t.time_s - t.time_s[0], atol=1e-3)


def test_gdal_reads_the_lines_of_the_geopackage(folder, results):
    frame = geopandas.read_file(folder / "trajectory.gpkg", layer="paths")
    assert set(frame.kind) == {"target", "camera"}
    for t in results.trajectories:
        line = frame[frame["name"] == t.target].geometry.iloc[0]
        np.testing.assert_allclose(enu_m(np.array(line.coords)), t.position_enu_m, atol=MILLIMETRE)


def test_the_geopackage_is_one_by_its_header_and_its_tables(folder):
    raw = (folder / "trajectory.gpkg").read_bytes()
    assert raw[:16] == b"SQLite format 3\0"
    assert raw[68:72] == b"GPKG"
    with sqlite3.connect(folder / "trajectory.gpkg") as file:
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert file.execute("PRAGMA foreign_key_check").fetchall() == []
        extent = file.execute("SELECT min_x, min_y, max_x, max_y FROM gpkg_contents WHERE table_name = 'positions'")
        west, south, east, north = extent.fetchone()
    file.close()
    x, y, _ = points_of(geopandas.read_file(folder / "trajectory.gpkg", layer="positions")).T
    assert (west, south, east, north) == pytest.approx((x.min(), y.min(), x.max(), y.max()))


def test_a_flight_without_utc_or_targets_is_a_geopackage_too(tmp_path):
    none = written(tmp_path, tiny_results(trajectories=(), utc_s=None))
    assert len(geopandas.read_file(none / "trajectory.gpkg", layer="positions")) == 0
    timeless = written(tmp_path, tiny_results(utc_s=None))
    assert geopandas.read_file(timeless / "trajectory.gpkg", layer="positions").utc.isna().all()


def test_geopandas_reads_the_geoparquet(folder, results):
    frame = geopandas.read_parquet(folder / "trajectory.parquet")
    assert frame.crs.to_string() == "OGC:CRS84"
    for t in results.trajectories:
        own = frame[frame.target == t.target]
        np.testing.assert_allclose(enu_m(points_of(own)), t.position_enu_m, atol=MILLIMETRE)
        np.testing.assert_allclose(own.time_s, t.time_s, atol=1e-6)
    assert str(frame.utc.dt.tz) == "UTC"


def test_off_the_map_the_geoparquet_has_metres_and_no_points(tmp_path):
    frame = geopandas.read_parquet(written(tmp_path, tiny_results(origin=None)) / "trajectory.parquet")
    assert frame.geometry.isna().all()
    assert frame.east_m.notna().all()


@pytest.mark.parametrize(("name", "target"), [("trajectory", BUS), ("trajectory-van__1_____co___Z_rich", VAN)])
def test_pymavlink_reads_the_mission(folder, results, name, target, monkeypatch):
    from pymavlink import mavutil, mavwp

    # whoever imports mavutil first decides its version of MAVLink, the environment which one is asked for later
    monkeypatch.setenv("MAVLINK20", "1")
    monkeypatch.setattr(mavutil, "mavlink", mavutil.mavlink)
    monkeypatch.setattr(mavutil, "current_dialect", mavutil.current_dialect)
    mavutil.set_dialect("ardupilotmega")

    t = next(t for t in results.trajectories if t.target == target)
    loader = mavwp.MAVWPLoader()
    loader.load(str(folder / f"{name}.waypoints"))
    home, *way = [loader.wp(i) for i in range(loader.count())]
    place = np.array([[w.y, w.x, w.z + home.z] for w in way])
    gaps = np.linalg.norm(enu_m(place)[:, None] - t.position_enu_m, axis=2)
    assert gaps.min(axis=1).max() < MILLIMETRE
    rows = gaps.argmin(axis=1)
    assert (rows[0], rows[-1]) == (0, len(t.time_s) - 1)
    assert (np.diff(t.time_s[rows])[:-1] >= 0.9).all()
    assert [(w.seq, w.current, w.command) for w in (home, way[0])] == [(0, 1, 16), (1, 0, 16)]
    assert (home.frame, {w.frame for w in way}) == (0, {3})
    assert (home.x, home.y, home.z) == pytest.approx((np.degrees(ORIGIN.lat_rad), np.degrees(ORIGIN.lon_rad), 500.0))


def test_a_long_way_has_no_more_waypoints_than_an_autopilot_takes(results):
    t = results.trajectories[0]
    many = np.linspace(0, 7200, 7201)
    long = dataclasses.replace(
        t, time_s=many, position_enu_m=np.column_stack([many, many, 0 * many]),
        velocity_mps=np.ones((7201, 3)), covariance=np.tile(np.eye(3), (7201, 1, 1)),
    )  # fmt: skip
    text = export_all(dataclasses.replace(results, trajectories=(long,)))["trajectory.waypoints"]
    assert 0.9 * MOST < len(text.splitlines()) - 2 <= MOST + 2


def test_the_same_results_give_the_same_bytes(folder, results):
    again = export_all(tiny_results())
    for name in ("trajectory.gpkg", "trajectory.parquet"):
        assert (folder / name).read_bytes() == again[name]


def test_gdal_reads_the_geojson(folder, results):
    lines = geopandas.read_file(folder / "trajectory.geojson")
    for t in results.trajectories:
        own = lines[(lines["name"] == t.target) & (lines.geom_type == "LineString")].geometry.iloc[0]
        np.testing.assert_allclose(enu_m(np.array(own.coords)), t.position_enu_m, atol=MILLIMETRE)


def test_the_kml_plays_each_place_at_its_moment(folder, results):
    """gx:Track: a `when` and a `gx:coord` for each place, read by ElementTree; UTC by the standard library."""
    space = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    tree = ElementTree.parse(folder / "trajectory.kml")
    marks = [m for m in tree.iter(f"{{{space['k']}}}Placemark") if m.find(".//gx:Track", space) is not None]
    found = {mark.findtext("k:name", namespaces=space): mark for mark in marks}
    for t in results.trajectories:
        track = found[t.target]
        coords = np.array([c.text.split() for c in track.iterfind(".//gx:coord", space)], float)
        whens = [datetime.fromisoformat(w.text).timestamp() for w in track.iterfind(".//k:when", space)]
        np.testing.assert_allclose(enu_m(coords), t.position_enu_m, atol=MILLIMETRE)
        np.testing.assert_allclose(np.array(whens) - results.utc_s, t.time_s, atol=1e-3)


def test_gpx_and_czml_have_the_same_places(folder, results):
    gpx = ElementTree.parse(folder / "trajectory.gpx").getroot()
    space = {"g": gpx.tag.split("}")[0].strip("{")}
    ways = {way.findtext("g:name", namespaces=space): way for way in gpx.iterfind(".//g:trk", space)}
    packets = {p.get("name"): p for p in json.loads((folder / "trajectory.czml").read_text()) if "position" in p}
    for t in results.trajectories:
        points = [(p.get("lon"), p.get("lat"), p.findtext("g:ele", namespaces=space))
                  for p in ways[t.target].iterfind(".//g:trkpt", space)]  # fmt: skip
        across = enu_m(np.array(points, float))[:, :2]  # ele is above mean sea level, or what the file says it is
        np.testing.assert_allclose(across, t.position_enu_m[:, :2], atol=0.05)
        flat = np.array(packets[t.target]["position"]["cartographicDegrees"], float).reshape(-1, 4)
        np.testing.assert_allclose(enu_m(flat[:, 1:]), t.position_enu_m, atol=MILLIMETRE)


def test_evo_reads_the_trajectories_and_writes_them_back(folder, results, tmp_path):
    """evo is GPL-3.0: a program of its own that a user opens the file with, here a test does."""
    evo = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed (pip install evo)")
    for name, target in (("trajectory", BUS), ("trajectory-van__1_____co___Z_rich", VAN)):
        t = next(t for t in results.trajectories if t.target == target)
        read = evo.read_tum_trajectory_file(str(folder / f"{name}.tum"))
        assert read.check()[0]
        np.testing.assert_allclose(read.positions_xyz, t.position_enu_m, atol=MILLIMETRE)
        np.testing.assert_allclose(read.timestamps, t.time_s + (results.utc_s or 0.0), atol=1e-3)
        evo.write_tum_trajectory_file(str(tmp_path / "again.tum"), read)
        again = np.loadtxt(tmp_path / "again.tum")
        np.testing.assert_allclose(again[:, 1:4], t.position_enu_m, atol=MILLIMETRE)


def test_stone_soup_reads_the_trajectories(folder, results):
    """As truth for its trackers, by its own reader of tables."""
    generic = pytest.importorskip("stonesoup.reader.generic", reason="Stone Soup is not installed")
    reader = generic.CSVGroundTruthReader(
        folder / "trajectory.csv", state_vector_fields=("east_m", "north_m", "up_m"), time_field="utc",
        path_id_field="target",
    )  # fmt: skip
    paths = {id(path): path for _, some in reader for path in some}.values()
    assert len(paths) == len(results.trajectories)
    for t in results.trajectories:
        near = [p for p in paths if np.allclose(np.ravel(p[0].state_vector), t.position_enu_m[0], atol=MILLIMETRE)]
        assert len(near) == 1
        table = np.array([np.ravel(state.state_vector) for state in near[0]], float)
        seconds = np.array([s.timestamp.replace(tzinfo=UTC).timestamp() for s in near[0]]) - results.utc_s
        np.testing.assert_allclose(table, t.position_enu_m, atol=MILLIMETRE)
        np.testing.assert_allclose(seconds, t.time_s, atol=1e-3)
