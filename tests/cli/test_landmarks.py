"""`runningfix landmarks`: a list of surveyed points into a flight file, and from there into a solution."""

import json

import numpy as np
import pytest

from pipeline.cli.main import main
from pipeline.flight import read_flight
from tests.scenes.table_flight import write_table_flight

pytest.importorskip("pyproj")


@pytest.fixture
def flight(tmp_path):
    return write_table_flight(tmp_path)[0]


def asked(capsys, *arguments):
    code = main(["landmarks", *map(str, arguments), "--json"])
    out = capsys.readouterr().out
    return code, json.loads(out) if out else {}


def test_opendronemap_into_a_new_flight_file(capsys, flight):
    before = flight.read_bytes()
    listed = flight.with_name("gcp_list.txt")
    listed.write_text(
        "EPSG:4326\n9.1 47.2 400.25 612.4 340.2 uav1_000012.png mast\n9.1 47.2 400.25 300 200.5 uav2_000003.png mast\n"
        "9.2 47.2 1 1 2 uav1_000012.png roof's\n9.3 47.2 1 1 2 elsewhere.png far\n"
    )
    code, said = asked(capsys, flight, listed, "--datum", "msl", "--check", "roof's", "--sigma-up-m", 0.2)
    assert code == 0
    assert flight.read_bytes() == before
    new = read_flight(flight.with_name("flight-landmarks.toml"))
    mast, roof = new.landmarks
    assert (np.degrees(mast.place.lat_rad), np.degrees(mast.place.lon_rad)) == pytest.approx((47.2, 9.1), abs=1e-9)
    assert (mast.place.height_m, mast.datum, mast.sigma_m, mast.sigma_up_m) == (400.25, "msl", 0.05, 0.2)
    assert [(m.frame, m.x_px, m.y_px) for m in mast.points["uav1"]] == [(12, 612.4, 340.2)]
    assert [(m.frame, m.x_px, m.y_px) for m in mast.points["uav2"]] == [(3, 300.0, 200.5)]
    assert (roof.name, roof.check, mast.check) == ("roof's", True, False)
    assert said["landmarks"][0] == {"name": "mast", "marks": {"uav1": 1, "uav2": 1}}
    assert any("elsewhere.png" in w for w in said["warnings"])
    assert any("far" in w for w in said["warnings"])


def test_pix4d_into_a_new_flight_file(capsys, flight):
    marks, points = flight.with_name("marks.csv"), flight.with_name("gcps.csv")
    marks.write_text("uav1_13.png,mast,100.5,200.5\n")
    points.write_text("mast,47.2,9.1,400.25,0.02,0.03\n")
    asked_for = (flight, marks, "--coordinates", points, "--crs", "EPSG:4979", "--first-frame", 1)
    assert asked(capsys, *asked_for)[0] == 0
    mast = read_flight(flight.with_name("flight-landmarks.toml")).landmarks[0]
    assert (mast.points["uav1"][0].frame, mast.points["uav1"][0].x_px) == (12, 100.0)
    assert (mast.sigma_m, mast.sigma_up_m, mast.datum) == (0.02, 0.03, "ellipsoid")
    assert np.degrees(mast.place.lat_rad) == pytest.approx(47.2)
    assert asked(capsys, *asked_for)[0] == 6  # nothing is written over


@pytest.mark.parametrize(
    ("text", "more", "code", "said"),
    [
        ("EPSG:4326\n9 47 1 1 2 uav1_1.png p\n", (), 2, "--datum"),
        ("uav1_1.png,p,1,2\n", ("--crs", "EPSG:4979"), 2, "--coordinates"),
        ("EPSG:4979\n9 47 1 1 2 else_1.png p\n", (), 3, "uav1_000120.png"),
        ("EPSG:4979\n9 47 1 1 2 uav1_1.png p\n9 47 1 1 2 uav1-1.png p\n", (), 3, "again"),
        ("EPSG:4979\n9 47 1 1 2 uav1_1.png p\n", ("--check", "q"), 2, '"q"'),
        ("EPSG:4979\n9 47 1 1 2 uav1_1.png p\n", ("--sigma-m", "-1"), 2, "above zero"),
        ("EPSG:4979\n9 47 1 1 2 uav1_1.png p\n", ("--write", "/nowhere/f.toml"), 6, "another folder"),
    ],
)
def test_what_is_not_said_is_refused_and_nothing_written(capsys, flight, text, more, code, said):
    listed = flight.with_name("list.txt")
    listed.write_text(text)
    assert main(["landmarks", str(flight), str(listed), *more]) == code
    assert said in capsys.readouterr().err
    assert not flight.with_name("flight-landmarks.toml").exists()


def test_a_name_that_is_a_target_is_refused(capsys, flight):
    flight.write_text(flight.read_text() + "\n[targets.mast]\norder = 1\n")
    listed = flight.with_name("list.txt")
    listed.write_text("EPSG:4979\n9 47 1 1 2 uav1_1.png mast\n")
    assert main(["landmarks", str(flight), str(listed)]) == 2
    assert '"mast"' in capsys.readouterr().err
