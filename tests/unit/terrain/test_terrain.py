"""A GeoTIFF becomes heights in local ENU: place, datum, unit, slope, roughness, voids and edges."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.geometry.geodesy import Geodetic, geodetic_from_enu
from pipeline.terrain import level_ground, read_terrain

rasterio = pytest.importorskip("rasterio")
ORIGIN = Geodetic.from_degrees(28.2, 112.9, 60.0)
AROUND = np.zeros((1, 2))


def sea(lat, lon):
    return np.full(np.shape(lat), -17.0)


def plane(east, north):
    """Ellipsoidal height of a slope."""
    return 80 + 0.05 * east - 0.02 * north


def written(tmp_path, *, crs="EPSG:32649", cell=10.0, values=None, units=None, nodata=None, half=800.0):
    """A model of `plane` in UTM, heights above the ellipsoid."""
    from rasterio.warp import transform

    x, y = (v[0] for v in transform("EPSG:4326", "EPSG:32649", [112.9], [28.2]))
    count = int(2 * half / cell)
    columns = x - half + (np.arange(count) + 0.5) * cell
    rows = y + half - (np.arange(count) + 0.5) * cell
    grid = np.meshgrid(columns, rows)
    lon, lat = transform("EPSG:32649", "EPSG:4326", grid[0].ravel(), grid[1].ravel())
    from pipeline.geometry.geodesy import enu_from_geodetic

    enu = enu_from_geodetic(np.radians(lat), np.radians(lon), np.full(len(lat), 60.0), ORIGIN)
    height = plane(enu[:, 0], enu[:, 1]).reshape(count, count) if values is None else values
    path = tmp_path / "dem.tif"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(
            path, "w", driver="GTiff", height=count, width=count, count=1, dtype="float32", crs=crs, nodata=nodata,
            transform=rasterio.transform.from_origin(x - half, y + half, cell, cell),
        ) as out:  # fmt: skip
            out.write(height.astype(np.float32), 1)
            if units:
                out.units = (units,)
    return path


def read(path, datum="ellipsoid", **given):
    return read_terrain(path, origin=ORIGIN, around_m=AROUND, geoid=sea, datum=datum, **given)


def test_places_heights_and_slopes_are_those_of_the_model(tmp_path):
    model = read(written(tmp_path))
    place = np.random.default_rng(1).uniform(-500, 500, (200, 2))
    found = model.at(place)
    geodetic = geodetic_from_enu(np.column_stack([place, found.up_m]), ORIGIN)
    np.testing.assert_allclose(geodetic[:, 2], plane(*place.T), atol=0.02)
    np.testing.assert_allclose(found.slope, np.tile([0.05, -0.02], (200, 1)), atol=3e-4)
    assert found.known.all()
    assert model.cell_m == pytest.approx(10.0, rel=1e-3)
    assert (found.rough_m < 0.06).all()  # a plane hides nothing between its cells


def test_slopes_are_the_derivatives_of_heights(tmp_path):
    bumps = 100 + np.random.default_rng(2).normal(size=(160, 160))
    model = read(written(tmp_path, values=bumps))
    place = np.random.default_rng(3).uniform(-500, 500, (300, 2))
    for axis in range(2):
        step = 1e-4 * np.eye(2)[axis]
        rise = (model.at(place + step).up_m - model.at(place - step).up_m) / 2e-4
        assert np.median(np.abs(rise - model.at(place).slope[:, axis])) < 1e-6
    assert 0.3 < np.median(model.at(place).rough_m) < 1.2  # white noise of a metre between cells


def test_mean_sea_level_is_brought_to_the_ellipsoid(tmp_path):
    path = written(tmp_path)
    off = read(path, "msl").at(AROUND).up_m - read(path).at(AROUND).up_m
    assert off == pytest.approx(-17.0)
    assert "mean sea level" in read(path, "msl").words


def test_feet_are_feet(tmp_path):
    found = read(written(tmp_path, units="foot")).at(AROUND)
    assert found.up_m[0] == pytest.approx(80 * 0.3048 - 60, abs=0.05)
    with pytest.raises(InputFileError, match="furlong"):
        read(written(tmp_path, units="furlong"))


def test_a_model_that_says_its_datum_is_believed_and_contradiction_refused(tmp_path):
    path = written(tmp_path, crs="EPSG:32649+5773")
    assert read(path, None).at(AROUND).up_m[0] == pytest.approx(80 - 60 - 17, abs=0.05)
    with pytest.raises(InputFileError, match="msl"):
        read(path, "ellipsoid")


def test_a_model_without_a_datum_is_not_guessed(tmp_path):
    with pytest.raises(InputFileError, match="what its heights count from") as caught:
        read(written(tmp_path), None)
    assert 'datum = "msl"' in caught.value.advice


def test_voids_and_edges_are_not_known(tmp_path):
    values = np.full((160, 160), 70.0)
    values[70:90, 90:110] = -9999
    model = read(written(tmp_path, values=values, nodata=-9999))
    found = model.at(np.array([[0.0, -200.0], [200.0, 0.0], [5000.0, 0.0]]))
    assert found.known.tolist() == [True, False, False]
    assert found.up_m[:2] == pytest.approx([10.0, 10.0], abs=0.05)  # the nearest that is known


def test_a_model_of_another_place_is_refused(tmp_path):
    path = written(tmp_path)
    with pytest.raises(InputFileError, match="elsewhere"):
        read_terrain(path, origin=Geodetic.from_degrees(28.6, 112.9, 0), around_m=AROUND, geoid=sea, datum="msl")
    (tmp_path / "no.tif").write_bytes(b"nothing")
    with pytest.raises(InputFileError, match="cannot be read"):
        read(tmp_path / "no.tif")


def test_level_ground_falls_with_the_earth():
    at = level_ground(61.2, ORIGIN, 1.0)
    place = np.array([[0.0, 0.0], [3000.0, 1000.0]])
    found = at(place)
    geodetic = geodetic_from_enu(np.column_stack([place, found.up_m]), ORIGIN)
    np.testing.assert_allclose(geodetic[:, 2], 61.2, atol=5e-3)
    assert level_ground(61.2, ORIGIN, 1.0, sea)(place).up_m[0] == pytest.approx(61.2 - 17 - 60)
