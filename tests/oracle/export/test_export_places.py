"""Places on the map against PROJ, and tables against pandas."""

from __future__ import annotations

import io
import json

import numpy as np
import pandas as pd
from pyproj import Transformer

from pipeline.export import czml, geojson, trajectory_csv
from tests.scenes.export import BUS, tiny_results

PROJ = Transformer.from_pipeline(
    "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lon_0=8.5 +lat_0=47.4 +h_0=500 "
    "+step +inv +proj=cart +ellps=WGS84"
)


def truth() -> np.ndarray:
    """Longitude, latitude, height of the bus by PROJ."""
    east, north, up = tiny_results().trajectories[0].position_enu_m.T
    return np.column_stack(PROJ.transform(east, north, up))


def metres(places: np.ndarray) -> np.ndarray:
    return (places - truth()) * [111e3 * np.cos(np.radians(47.4)), 111e3, 1.0]


def test_trajectory_csv_is_within_a_tenth_of_a_millimetre() -> None:
    found = pd.read_csv(io.StringIO(trajectory_csv(tiny_results())))
    places = found[found.target == BUS][["longitude_deg", "latitude_deg", "height_m"]].to_numpy()
    assert np.abs(metres(places)).max() < 1e-4


def test_geojson_and_czml_are_within_a_millimetre() -> None:
    line = json.loads(geojson(tiny_results()))["features"][0]["geometry"]["coordinates"]
    assert np.abs(metres(np.array(line))).max() < 1e-3
    samples = json.loads(czml(tiny_results()))[1]["position"]["cartographicDegrees"]
    assert np.abs(metres(np.array(samples).reshape(-1, 4)[:, 1:])).max() < 1e-3


def test_utc_column_is_what_pandas_takes_for_it() -> None:
    results = tiny_results(utc_s=1.7e9 + 0.123456)
    found = pd.read_csv(io.StringIO(trajectory_csv(results)))
    utc = pd.to_datetime(found.utc, format="ISO8601")
    expected = pd.Timestamp(1.7e9, unit="s", tz="UTC") + pd.to_timedelta(found.time_s + 0.123456, unit="s")
    assert ((utc - expected).abs() <= pd.Timedelta(1, "us")).all()
    assert str(utc.dt.tz) == "UTC"
