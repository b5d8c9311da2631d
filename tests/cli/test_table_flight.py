"""A flight of detections and pose tables over the command line: results, summary, resuming."""

import json

import pandas as pd
import pytest

from pipeline.cli.main import main
from scripts.validation.check_resume import contents, differences
from tests.scenes.table_flight import write_table_flight


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    flight, truth = write_table_flight(folder)
    assert main(["run", str(flight), "-o", str(folder / "out"), "--quiet"]) == 0
    return flight, truth, folder / "out"


def test_the_files_of_a_run(done):
    names = {p.name for p in done[2].iterdir()}
    assert names >= {
        "tracks.csv", "poses.csv", "timing.csv", "trajectory.csv", "sightings.csv", "solution.json", "report.html",
        "trajectory.geojson", "trajectory.kml", "trajectory.czml", "trajectory.gpx", "trajectory.tum",
        "trajectory.gpkg", "trajectory.waypoints", "trajectory.parquet",
    }  # fmt: skip


def test_the_offset_is_found_within_three_sigma(done):
    _, truth, out = done
    timing = pd.read_csv(out / "timing.csv").set_index("camera").loc["uav2"]
    assert abs(timing.offset_s - truth.offset_s["uav2"]) < 3 * timing.offset_sigma_s
    assert timing.offset_sigma_s < 0.1


def test_a_second_run_does_nothing_and_says_so(done, capsys):
    flight, _, out = done
    before = contents(out)
    assert main(["run", str(flight), "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["skipped"] == ["track", "poses", "solve"]
    assert said["status"] == "converged"
    assert contents(out) == before


def test_json_summary_of_solve(done, capsys):
    flight, _, out = done
    assert main(["solve", str(flight), "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["method"] == "map"
    assert {"iterations", "cost", "chi_square", "degrees_of_freedom", "warnings", "files"} <= said.keys()
    seconds = said["seconds"]
    assert list(seconds) == [
        "start", "check", "read", "poses", "compile", "search", "solver", "judge", "solve", "results", "pictures",
        "write", "total",
    ]  # fmt: skip
    inside = seconds["search"] + seconds["solver"] + seconds["judge"]
    assert 0.9 * seconds["solve"] < inside <= seconds["solve"]
    told = sum(seconds.values()) - inside - seconds["total"]
    assert 0.95 * seconds["total"] < told <= seconds["total"]


def test_another_method_needs_no_new_tracking(done, capsys):
    flight, _, out = done
    assert main(["run", str(flight), "-o", str(out), "--method", "intersection", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["method"] == "intersection"
    assert "track" in said["skipped"]
    assert main(["run", str(flight), "-o", str(out), "--quiet"]) == 0


def test_killed_runs_end_in_the_same_bytes(done, tmp_path):
    found, hits = differences(done[0], tmp_path, kills=3, seed=4)
    assert found == []
    assert hits >= 1
