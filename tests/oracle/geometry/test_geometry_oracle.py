"""Geodesy against PROJ and GeographicLib, the geoid against its publisher's check points, rotations against SciPy."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
from geographiclib.geodesic import Geodesic
from scipy.spatial.transform import Rotation

from pipeline.geometry import rotation
from pipeline.geometry.geodesy import (
    Geodetic,
    ecef_from_geodetic,
    enu_axes_turn,
    enu_axes_turn_many,
    enu_from_geodetic,
    geodetic_from_ecef,
    geodetic_from_enu,
)
from pipeline.telemetry.heights.egm96 import geoid_height_m

RNG = np.random.default_rng(7)
LAT = np.concatenate([np.radians(RNG.uniform(-90, 90, 400)), np.radians([90.0, -90.0, 0.0, 0.0, 45.0, 89.9999])])
LON = np.concatenate([np.radians(RNG.uniform(-180, 180, 400)), np.radians([0.0, 10.0, 180.0, -180.0, 179.99999, 5.0])])
HEIGHT = np.concatenate([RNG.uniform(-400, 9000, 400), [0.0, 100.0, 0.0, 50.0, 10.0, 3000.0]])


def angle_apart(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def test_ecef_is_that_of_proj():
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    theirs = np.stack(to_ecef.transform(np.degrees(LON), np.degrees(LAT), HEIGHT), axis=1)
    np.testing.assert_allclose(ecef_from_geodetic(LAT, LON, HEIGHT), theirs, atol=1e-6)


def test_latitude_longitude_and_height_are_those_of_proj():
    from_ecef = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    places = ecef_from_geodetic(LAT, LON, HEIGHT)
    lon, lat, height = from_ecef.transform(*places.T)
    ours = geodetic_from_ecef(places)
    away = np.abs(LAT) < np.radians(89.9)
    assert np.abs(ours[:, 0] - np.radians(lat)).max() < 1e-9
    assert angle_apart(ours[:, 1], np.radians(lon))[away].max() < 1e-9
    assert np.abs(ours[:, 2] - height).max() < 1e-4


@pytest.mark.parametrize(
    "origin", [(28.2, 112.9, 60.0), (0.0, 179.9999, 0.0), (-89.999, 10.0, 2800.0), (67.0, -180.0, 5.0)]
)
def test_local_enu_is_that_of_proj(origin):
    lat0, lon0, h0 = origin
    chain = pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={lat0} +lon_0={lon0} +h_0={h0}"
    )
    home = Geodetic.from_degrees(*origin)
    enu = RNG.uniform(-5000, 5000, (300, 3))
    places = geodetic_from_enu(enu, home)
    theirs = np.stack(chain.transform(np.degrees(places[:, 1]), np.degrees(places[:, 0]), places[:, 2]), axis=1)
    np.testing.assert_allclose(theirs, enu, atol=1e-4)
    np.testing.assert_allclose(enu_from_geodetic(*places.T, home), enu, atol=1e-6)


def test_distances_are_those_of_geographiclib():
    """A short chord is the geodesic, to a part in (distance / R)^2 / 24."""
    for lat, lon in [(28.2, 112.9), (-0.001, 179.9999), (60.0, -180.0), (89.9, 0.0)]:
        home = Geodetic.from_degrees(lat, lon, 0.0)
        for azimuth in (0.0, 77.0, 181.0, 300.0):
            there = Geodesic.WGS84.Direct(lat, lon, azimuth, 1000.0)
            enu = enu_from_geodetic(*(np.radians([there[k]]) for k in ("lat2", "lon2")), np.zeros(1), home)[0]
            assert np.linalg.norm(enu) == pytest.approx(1000.0, abs=1e-4)
            assert angle_apart(np.arctan2(enu[0], enu[1]), np.radians(azimuth)) < 1e-7


def test_axes_of_many_places_are_those_of_each():
    home = Geodetic.from_degrees(28.2, 112.9, 60.0)
    places = np.stack([LAT, LON, HEIGHT], axis=1)
    each = [enu_axes_turn(Geodetic(lat_rad=p[0], lon_rad=p[1], height_m=p[2]), home) for p in places]
    np.testing.assert_allclose(enu_axes_turn_many(places, home), each, atol=1e-14)


CHECK_POINTS = [  # the publisher's own test of its EGM96 program: latitude, longitude (degrees), geoid height (m)
    (38.6281550, 269.7791550, -31.628),
    (-14.6212170, 305.0211140, -2.969),
    (46.8743190, 102.4487290, -43.575),
    (-23.6174460, 133.8747120, 15.871),
    (38.6254730, 359.9995000, 50.066),
    (-0.4667440, 0.0023000, 17.329),
]


def test_mean_sea_level_is_within_half_a_metre_of_the_publishers_check_points():
    lat, lon, height = np.array(CHECK_POINTS).T
    np.testing.assert_allclose(geoid_height_m(np.radians(lat), np.radians(lon)), height, atol=0.1)
    np.testing.assert_allclose(geoid_height_m(np.radians(lat), np.radians(lon - 360)), height, atol=0.1)


def test_mean_sea_level_at_the_edges_of_its_grid():
    edges = geoid_height_m(np.radians([90, 90, -90, 0, 0, np.nan]), np.radians([0, 123, 7, 179.9999, -179.9999, 0]))
    assert edges[0] == edges[1] == pytest.approx(13.61, abs=0.01)
    assert edges[2] == pytest.approx(-29.53, abs=0.01)
    assert edges[3] == pytest.approx(edges[4], abs=1e-3)
    assert np.isnan(edges[5])


def scipy_of(q):
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def test_rotations_are_those_of_scipy():
    q = rotation.normalised(RNG.normal(size=(200, 4)))
    p = rotation.normalised(RNG.normal(size=(200, 4)))
    v = RNG.normal(size=(200, 3))
    np.testing.assert_allclose(rotation.matrix(q), scipy_of(q).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation.rotate(q, v), scipy_of(q).apply(v), atol=1e-13)
    np.testing.assert_allclose(
        rotation.matrix(rotation.multiply(q, p)), (scipy_of(q) * scipy_of(p)).as_matrix(), atol=1e-14
    )
    np.testing.assert_allclose(rotation.log(q), scipy_of(q).as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(rotation.matrix(rotation.exp(v)), Rotation.from_rotvec(v).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(
        rotation.matrix(rotation.from_matrix(rotation.matrix(q))), rotation.matrix(q), atol=1e-13
    )


def test_autopilot_angles_are_intrinsic_z_y_x():
    angles = np.stack(
        [RNG.uniform(-np.pi, np.pi, 200), RNG.uniform(-1.5, 1.5, 200), RNG.uniform(-np.pi, np.pi, 200)], 1
    )
    ours = rotation.ned_from_frd(*angles.T)
    np.testing.assert_allclose(rotation.matrix(ours), Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation.yaw_pitch_roll(ours), angles, atol=1e-12)
