"""Maps: places right, the antimeridian cut, datums said, names survive, nothing where there is no origin."""

from __future__ import annotations

import dataclasses
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from pipeline.export import czml, geojson, gpx, kml, tum, tum_of_others
from pipeline.export.maps.as_geojson import cut_at_antimeridian, line_or_point
from pipeline.export.text.places import geodetic_degrees, target_paths, thinned
from pipeline.geometry.geodesy import Geodetic
from pipeline.records import Results, Trajectory
from tests.scenes.export import BUS, VAN, tiny_results

KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"
GPX = "{http://www.topografix.com/GPX/1/1}"


def over_the_antimeridian() -> Results:
    """The bus drives east over 180 degrees, the van stays where it began."""
    return tiny_results(origin=Geodetic.from_degrees(-17.0, 179.9998, 5.0))


def features(results: Results, kind: str) -> list[dict]:
    return [f for f in json.loads(geojson(results))["features"] if f["properties"]["kind"] == kind]


def renamed(name: str) -> Results:
    results = tiny_results()
    return dataclasses.replace(
        results, trajectories=tuple(dataclasses.replace(t, target=name) for t in results.trajectories[:1])
    )


def test_geojson_has_lines_for_targets_points_for_seconds_and_cameras() -> None:
    results = tiny_results()
    assert [f["properties"]["name"] for f in features(results, "target")] == [BUS, VAN]
    assert [f["geometry"]["type"] for f in features(results, "camera")] == ["Point", "LineString"]
    seconds = [f["properties"]["time_s"] for f in features(results, "position") if f["properties"]["name"] == BUS]
    assert seconds == [1.0, 2.0, 3.0]
    assert features(results, "position")[0]["properties"]["sigma_up_m"] == 0.4
    assert features(results, "position")[-1]["properties"]["sigma_up_m"] is None


def test_geojson_is_cut_at_the_antimeridian() -> None:
    bus = features(over_the_antimeridian(), "target")[0]["geometry"]
    assert bus["type"] == "MultiLineString"
    west, east = bus["coordinates"]
    assert west[-1][0] == 180.0
    assert east[0][0] == -180.0
    assert west[-1][1:] == east[0][1:]
    assert all(179 < place[0] <= 180 for place in west)
    assert all(-180 <= place[0] < -179 for place in east)


def test_cut_point_lies_on_the_line() -> None:
    line = np.array([[179.0, 10.0, 0.0], [-179.0, 20.0, 100.0], [178.0, 20.0, 100.0]])
    first, second, third = cut_at_antimeridian(line)
    np.testing.assert_allclose(first, [[179, 10, 0], [180, 15, 50]])
    np.testing.assert_allclose(second, [[-180, 15, 50], [-179, 20, 100], [-180, 20, 100]])
    np.testing.assert_allclose(third, [[180, 20, 100], [178, 20, 100]])


def test_a_line_that_only_touches_is_not_torn() -> None:
    touching = np.array([[179.0, 0.0, 0.0], [179.5, 0.0, 0.0]])
    assert line_or_point(touching)["type"] == "LineString"
    onto = np.array([[179.0, 0.0, 0.0], [-180.0, 0.0, 0.0]])
    assert all(len(part) >= 2 for part in cut_at_antimeridian(onto))
    assert line_or_point(touching[:1])["type"] == "Point"


def test_thinning_keeps_both_ends() -> None:
    time = np.arange(0, 10.01, 0.1)
    rows = thinned(time, 1.0)
    np.testing.assert_allclose(time[rows], np.arange(0, 10.5, 1.0))
    assert thinned(time[:96], 1.0)[-1] == 95
    assert thinned(time[:1], 1.0).tolist() == [0]
    assert thinned(time[:0], 1.0).tolist() == []


def test_kml_has_a_time_slider_only_where_utc_is_known() -> None:
    known, unknown = ET.fromstring(kml(tiny_results())), ET.fromstring(kml(tiny_results(utc_s=None)))
    tracks = list(known.iter(f"{GX}Track"))
    assert len(tracks) == 3
    assert len(tracks[0].findall(f"{KML}when")) == len(tracks[0].findall(f"{GX}coord")) == 5
    assert not list(unknown.iter(f"{GX}Track"))
    assert not list(unknown.iter(f"{KML}when"))
    assert len(list(unknown.iter(f"{KML}LineString"))) == 5


def test_kml_says_its_datum_and_takes_the_geoid_off() -> None:
    plain, level = kml(tiny_results()), kml(tiny_results(), geoid_height_m=47.5)
    assert "heights above the WGS84 ellipsoid" in plain
    assert "above mean sea level: heights above the WGS84 ellipsoid less a geoid height of 47.50 m" in level
    first = [ET.fromstring(text).find(f".//{GX}coord") for text in (plain, level)]
    heights = [float((coord.text or "").split()[2]) for coord in first if coord is not None]
    assert heights == [500.5, 453.0]


def test_czml_without_utc_says_that_its_clock_is_a_stand_in() -> None:
    document = json.loads(czml(tiny_results(utc_s=None)))[0]
    assert document["clock"]["currentTime"].startswith("2000-01-01T00:00:00")
    assert "UTC is not known" in document["description"]
    assert "UTC is not known" not in czml(tiny_results())


def test_gpx_has_times_only_where_utc_is_known_and_no_longitude_of_180() -> None:
    assert f"{GPX}time" in {e.tag for e in ET.fromstring(gpx(tiny_results())).iter()}
    assert f"{GPX}time" not in {e.tag for e in ET.fromstring(gpx(tiny_results(utc_s=None))).iter()}
    assert "not above mean sea level" in gpx(tiny_results())
    place = np.array([[179.99999999999, 0.0, 0.0]])
    results = tiny_results(origin=Geodetic.from_degrees(0.0, place[0, 0], 0.0))
    still = dataclasses.replace(
        results.trajectories[0],
        time_s=[0.0],
        position_enu_m=np.zeros((1, 3)),
        velocity_mps=np.zeros((1, 3)),
        covariance=np.zeros((1, 3, 3)),
    )
    assert 'lon="-180.000000000"' in gpx(dataclasses.replace(results, trajectories=(still,)))


@pytest.mark.parametrize("name", ["a<b>&\"c'", "Zürich 東京", "bell\x07 and nul\x00", "]]>"])
def test_any_name_gives_a_valid_file(name: str) -> None:
    results = renamed(name)
    shown = name.replace("\x07", "\ufffd").replace("\x00", "\ufffd")
    names = [e.text for e in ET.fromstring(kml(results)).iter(f"{KML}name")]
    assert shown in names
    assert shown in [e.text for e in ET.fromstring(gpx(results)).iter(f"{GPX}name")]
    assert features(results, "target")[0]["properties"]["name"] == name
    assert json.loads(czml(results))[1]["name"] == name


def test_a_target_seen_at_one_instant_is_a_point() -> None:
    results = tiny_results()
    one = Trajectory(
        target="flash",
        time_s=np.array([1.0]),
        position_enu_m=np.zeros((1, 3)),
        velocity_mps=np.zeros((1, 3)),
        covariance=np.full((1, 3, 3), np.nan),
    )
    results = dataclasses.replace(results, trajectories=(one,))
    assert features(results, "target")[0]["geometry"] == {"type": "Point", "coordinates": [8.5, 47.4, 500.0]}
    assert ET.fromstring(kml(results)).find(f".//{KML}Point") is not None
    assert json.loads(czml(results))[1]["position"] == {"cartographicDegrees": [8.5, 47.4, 500.0]}
    assert gpx(results).count("<trkpt") == 1


def test_longitudes_are_from_minus_180_to_below_180() -> None:
    path = target_paths(over_the_antimeridian())[0]
    assert (path.place[:, 0] >= -180).all()
    assert (path.place[:, 0] < 180).all()
    assert np.abs(np.diff(path.place[:, 0])).max() > 359
    assert geodetic_degrees(np.zeros((1, 3)), Geodetic.from_degrees(10.0, 190.0, 0.0))[0, 0] == pytest.approx(-170)


def test_maps_need_an_origin() -> None:
    for write in (geojson, kml, czml, gpx):
        with pytest.raises(ValueError, match="without an origin"):
            write(tiny_results(origin=None))


def test_tum_is_on_utc_where_known_and_a_file_per_target() -> None:
    assert (tum(tiny_results()) or "").splitlines()[1] == "1740830401.000000 10.000000 -20.000000 0.500000 0 0 0 1"
    unknown = (tum(tiny_results(utc_s=None)) or "").splitlines()
    assert unknown[0].startswith("# target bus; timestamp: common time;")
    assert unknown[1].startswith("1.000000 ")
    assert tum(tiny_results(trajectories=())) is None


def test_tum_file_names_never_collide_or_leave_the_folder() -> None:
    base = tiny_results().trajectories[0]
    names = ("first", "a b", "a/b", "A_B", "../up")
    results = tiny_results(trajectories=tuple(dataclasses.replace(base, target=name) for name in names))
    assert list(tum_of_others(results)) == [
        "trajectory-a_b.tum",
        "trajectory-a_b-2.tum",
        "trajectory-A_B-3.tum",
        "trajectory-.._up.tum",
    ]


def test_tum_times_before_zero() -> None:
    base = tiny_results().trajectories[0]
    early = dataclasses.replace(base, time_s=base.time_s - 1.25)
    text = tum(tiny_results(utc_s=None, trajectories=(early,))) or ""
    assert [line.split()[0] for line in text.splitlines()[1:3]] == ["-0.250000", "0.250000"]
