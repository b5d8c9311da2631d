"""`runningfix new`: what lies in a folder becomes a flight file, guesses marked, nothing asked or written over."""

import csv
import json
import tomllib

import pytest

from pipeline.cli.main import main
from pipeline.flight import read_flight
from tests.scenes.table_flight import write_table_flight


@pytest.fixture
def folder(tmp_path):
    """Two cameras' tables of detections and poses, and their camera files; no flight file."""
    write_table_flight(tmp_path)[0].unlink()
    for name in ("uav1", "uav2"):
        table = tmp_path / f"{name}-tracks.csv"
        rows = list(csv.DictReader(table.read_text().splitlines()))
        text = "".join(f"{r['frame']},{r['target']},{r['x_px']},{r['y_px']}\n" for r in rows if r["x_px"])
        table.write_text("frame,target,x_px,y_px\n" + text)
    return tmp_path


def test_files_are_paired_by_their_names(capsys, folder):
    (folder / "notes.json").write_text("{}")
    (folder / "shopping.txt").write_text("milk\n")
    assert main(["new", str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    path = folder / "flight.toml"
    assert said["files"] == [str(path)]
    assert said["fill_in"] == []
    cameras = tomllib.loads(path.read_text())["cameras"]
    assert {name: (c["calibration"], c["telemetry"], c["tracks"]) for name, c in cameras.items()} == {
        name: (f"{name}.json", f"{name}-poses.csv", f"{name}-tracks.csv") for name in ("uav1", "uav2")
    }
    assert len(read_flight(path).cameras) == 2
    assert "# GUESSED" in path.read_text()


def test_what_is_missing_is_said_and_marked(capsys, folder):
    (folder / "uav2.json").unlink()
    (folder / "uav2-poses.csv").unlink()
    assert main(["new", str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    chosen = {c["name"]: c for c in said["cameras"]}
    assert chosen["uav2"]["telemetry"] is None
    assert chosen["uav2"]["calibration_guessed_by"] == "it is the only camera file"
    assert any("uav2: no log" in line for line in said["fill_in"])
    text = (folder / "flight.toml").read_text()
    assert "# GUESSED: it is the only camera file" in text
    assert "# FILL IN" in text


def test_a_flight_file_that_is_there_stays(capsys, folder):
    (folder / "flight.toml").write_text("mine")
    assert main(["new", str(folder)]) == 6
    assert "nothing of yours is written over" in capsys.readouterr().err
    assert (folder / "flight.toml").read_text() == "mine"


def test_a_folder_without_a_flight_is_refused(capsys, tmp_path):
    assert main(["new", str(tmp_path)]) == 3
    assert main(["new", str(tmp_path / "nowhere")]) == 3
    said = capsys.readouterr().err
    assert "no video" in said
    assert "no such folder" in said
