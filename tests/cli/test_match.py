"""`runningfix match`: pairs by what the cameras saw, whatever their targets are called."""

import json
import tomllib

import pytest

from pipeline.cli.main import main
from pipeline.flight import read_flight
from tests.scenes.table_flight import write_table_flight


@pytest.fixture
def flight(tmp_path):
    """A flight whose second camera calls its targets otherwise."""
    path = write_table_flight(tmp_path)[0]
    table = tmp_path / "uav2-tracks.csv"
    rows = table.read_text().splitlines()
    first, second = sorted({row.split(",")[1] for row in rows[1:]})
    swapped = {first: "x", second: first}
    table.write_text("\n".join([rows[0], *(renamed(row, swapped) for row in rows[1:])]) + "\n")
    return path, {first: "x", second: first}


def renamed(row, names):
    cells = row.split(",")
    return ",".join([cells[0], names[cells[1]], *cells[2:]])


def test_tables_and_flight_file_under_common_names(capsys, flight):
    path, called = flight
    before = {p.name: p.read_bytes() for p in path.parent.iterdir()}
    assert main(["match", str(path), "-o", str(path.parent / "out"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    told = {t["tracks"]["uav1"]: t["tracks"]["uav2"] for t in said["targets"] if len(t["tracks"]) == 2}
    doubted = {d["first"]["target"]: d["second"]["target"] for d in said["doubtful"]}
    assert {**told, **doubted}.items() <= called.items()
    new = path.with_name("flight-matched.toml")
    assert str(new) in said["files"]
    assert {c.tracks.name for c in read_flight(new).cameras} == {"uav1-tracks-matched.csv", "uav2-tracks-matched.csv"}
    assert set(tomllib.loads(new.read_text())["targets"]) == {t["name"] for t in said["targets"]}
    assert {name: (path.parent / name).read_bytes() for name in before} == before


def test_a_second_match_writes_over_nothing(capsys, flight):
    path, _ = flight
    path.with_name("flight-matched.toml").write_text("mine")
    assert main(["match", str(path), "-o", str(path.parent / "out")]) == 6
    assert "nothing of yours is written over" in capsys.readouterr().err
    assert path.with_name("flight-matched.toml").read_text() == "mine"


def test_one_camera_has_nothing_to_be_matched_with(capsys, flight):
    path, _ = flight
    text = path.read_text()
    path.write_text(text[: text.index("[cameras.uav2]")])
    assert main(["match", str(path), "-o", str(path.parent / "out")]) == 2
    assert "nothing to be matched with" in capsys.readouterr().err
