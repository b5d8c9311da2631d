"""Coordinates in any system become WGS84; heights are what somebody says they are."""

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.survey import ControlPoint, places

pytest.importorskip("pyproj")


def placed(system, *coordinates, east_first=True, datum=None):
    point = ControlPoint(name="mast", first=coordinates[0], second=coordinates[1], height=coordinates[2])
    return places([point], system, east_first=east_first, datum=datum, where="list.txt")


def test_utm_against_the_central_meridian():
    # on the central meridian of zone 16, easting is 500 km and northing 0.9996 of the meridian's arc
    found = placed("WGS84 UTM 16N", 500000.0, 0.9996 * 4984944.377977, 5.0, datum="ellipsoid")
    assert found.lon_deg[0] == pytest.approx(-87.0, abs=1e-9)
    assert found.lat_deg[0] == pytest.approx(45.0, abs=1e-8)
    assert (found.height_m[0], found.datum, found.notes) == (5.0, "ellipsoid", ())


def test_the_order_of_two_coordinates():
    east = placed("EPSG:4326", 9.1, 47.2, 400.0, datum="msl")
    as_defined = placed("EPSG:4326", 47.2, 9.1, 400.0, east_first=False, datum="msl")
    utm = placed("EPSG:32632", 500000.0, 5e6, 400.0, east_first=False, datum="msl")  # its axes: easting first
    for found in (east, as_defined):
        assert (found.lat_deg[0], found.lon_deg[0]) == (47.2, 9.1)
    assert utm.lon_deg[0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("system", "said"), [("EPSG:4979", "ellipsoid"), ("EPSG:4326+5773", "msl"), ("EPSG:4326+3855", "msl")]
)
def test_a_system_says_what_its_heights_are(system, said):
    assert placed(system, 9.0, 47.0, 400.0).datum == said
    other = {"ellipsoid": "msl", "msl": "ellipsoid"}[said]
    with pytest.raises(UsageError) as caught:
        placed(system, 9.0, 47.0, 400.0, datum=other)
    assert other in caught.value.seen


def test_heights_that_nobody_explains_are_refused():
    with pytest.raises(UsageError) as caught:
        placed("EPSG:32616", 500000.0, 5e6, 5.0)
    assert "--datum" in caught.value.advice


def test_heights_in_feet_and_a_national_sea_level():
    found = placed("EPSG:2227+6360", 6e6, 2.1e6, 100.0, datum="msl")  # NAVD88 in US survey feet
    assert found.height_m[0] == pytest.approx(100 * 1200 / 3937)
    assert any("NAVD88" in note for note in found.notes)
    with pytest.raises(InputFileError) as caught:
        placed("EPSG:2227", 6e6, 2.1e6, 100.0, datum="msl")
    assert "foot" in caught.value.seen


def test_a_coarse_way_to_wgs84_is_said():
    found = placed("EPSG:26716", 500000.0, 4e6, 100.0, datum="msl")  # NAD27
    assert np.isfinite(found.lat_deg[0])
    assert any("PROJ knows a way of" in note for note in found.notes)


@pytest.mark.parametrize(
    ("system", "first", "second", "seen"),
    [("EPSG:4326", 47.0, 190.0, "47, 190"), ("EPSG:32616", 1e9, 1e9, "1e+09"), ("EPSG:999999", 1, 1, "EPSG:999999"),
     ("EPSG:4978", 1, 1, "no latitude")],
)  # fmt: skip
def test_places_that_cannot_be_are_refused(system, first, second, seen):
    with pytest.raises(InputFileError) as caught:
        placed(system, first, second, 1.0, datum="ellipsoid")
    assert seen in caught.value.seen
