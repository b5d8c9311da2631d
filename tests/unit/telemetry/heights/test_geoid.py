"""Which geoid: EGM2008 where PROJ finds its grid, else EGM96; the name goes with the number."""

from __future__ import annotations

import struct

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


@pytest.mark.usefixtures("no_grid")
def test_egm96_where_it_is_not():
    assert geoid.geoid_name() == "EGM96"
    np.testing.assert_array_equal(geoid.geoid_height_m(LAT, LON), egm96.geoid_height_m(LAT, LON))


@pytest.fixture
def no_grid(monkeypatch):
    monkeypatch.setattr(geoid, "_egm2008", lambda: None)
