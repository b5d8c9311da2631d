"""Which geoid: EGM2008 where PROJ finds its grid, else EGM96; the name goes with the number."""

from __future__ import annotations

import hashlib
import struct
import sys
import types
from itertools import pairwise

import numpy as np
import pytest

from pipeline.telemetry.heights import egm96, geoid
from pipeline.telemetry.heights.undulation import on_ellipsoid

LAT, LON = np.radians([28.2, -45.0]), np.radians([112.9, 250.0])


@pytest.fixture
def grid(tmp_path, monkeypatch):
    """A grid of PROJ's (GTX) in EGM2008's stead: 10 m, and 0.1 m more for each degree of latitude."""
    rows, columns = 19, 37
    head = struct.pack(">4d2i", -90.0, -180.0, 10.0, 10.0, rows, columns)
    value = np.repeat(10.0 + 0.1 * np.arange(-90.0, 91.0, 10.0), columns)
    (tmp_path / "egm08_25.gtx").write_bytes(head + value.astype(">f4").tobytes())
    monkeypatch.setattr(geoid, "GRIDS", ("none.gtx", str(tmp_path / "egm08_25.gtx")))
    geoid._egm2008.cache_clear()
    yield
    geoid._egm2008.cache_clear()


def test_egm2008_where_its_grid_is(grid):
    assert geoid.geoid_name() == "EGM2008"
    np.testing.assert_allclose(geoid.geoid_height_m(LAT, LON), [12.82, 5.5], atol=1e-4)
    words, height = on_ellipsoid(np.array([100.0, 100.0]), None, np.degrees(LAT), np.degrees(LON))
    assert "EGM2008" in words
    np.testing.assert_allclose(height, [112.82, 105.5], atol=1e-4)
    assert np.isnan(geoid.geoid_height_m(np.array([np.nan]), np.array([0.0]))[0])


def test_proj_is_not_asked_where_no_grid_lies(monkeypatch, tmp_path):
    monkeypatch.setattr(geoid, "GRIDS", ("none.gtx",))
    geoid._egm2008.cache_clear()
    monkeypatch.setattr(geoid, "_places", lambda: [tmp_path])
    monkeypatch.setitem(sys.modules, "pyproj", types.ModuleType("pyproj"))  # to ask it for anything is an error
    assert geoid.geoid_name() == "EGM96"
    geoid._egm2008.cache_clear()


@pytest.mark.parametrize("name", ["PROJ_DATA", "PROJ_LIB", "PROJ_USER_WRITABLE_DIRECTORY"])
def test_a_grid_is_found_where_proj_is_told_to_look(grid, monkeypatch, tmp_path, name):
    monkeypatch.setattr(geoid, "GRIDS", ("egm08_25.gtx",))
    assert not geoid._may_be_there()
    monkeypatch.setenv(name, str(tmp_path))
    assert geoid._may_be_there()


def test_the_grid_of_egm96_is_whole():
    bands = [egm96._band_m(band) for band in range(36)]
    for upper, lower in pairwise(bands):
        np.testing.assert_array_equal(upper[-1], lower[0])
    every = np.concatenate([*(band[:-1] for band in bands), bands[-1][-1:]])
    assert every.shape == (egm96.ROWS, egm96.COLUMNS)
    assert hashlib.sha256(np.round(100 * every).astype("<i2").tobytes()).hexdigest() == (
        "53dc06fa2aff894a841ff59a24bd7c99ddf569a0a97655808d8aea27272a6800"
    )  # of the grid as it was published, in centimetres


def test_places_on_both_sides_of_a_band():
    lat = np.radians(90.0 - np.array([4.99, 5.0, 5.01, 180.0, 0.0]))
    height = egm96.geoid_height_m(lat, np.zeros(5))
    assert np.abs(np.diff(height[:3])).max() < 0.1
    np.testing.assert_allclose(height[3:], [-29.53, 13.61])  # the poles


@pytest.mark.usefixtures("no_grid")
def test_egm96_where_it_is_not():
    assert geoid.geoid_name() == "EGM96"
    np.testing.assert_array_equal(geoid.geoid_height_m(LAT, LON), egm96.geoid_height_m(LAT, LON))


@pytest.fixture
def no_grid(monkeypatch):
    monkeypatch.setattr(geoid, "_egm2008", lambda: None)
