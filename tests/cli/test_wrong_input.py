"""What a user can get wrong: one clear message, the right exit code, no traceback, no half-written file."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cli.main import main
from tests.scenes.table_flight import write_table_flight


@pytest.fixture
def flight(tmp_path):
    return write_table_flight(tmp_path)[0]


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def refused(capsys, *arguments: object) -> tuple[int, str]:
    """Exit code and the one line that was said."""
    code = main([str(a) for a in arguments])
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert said.err.count("\n") == 1, said.err
    return code, said.err


def solve(capsys, flight: Path) -> tuple[int, str]:
    out = flight.parent / "out"
    code, said = refused(capsys, "solve", flight, "-o", out)
    assert not out.exists() or not list(out.rglob("*")), "a refused run leaves nothing"
    return code, said


def test_missing_flight_file(capsys, tmp_path):
    code, said = refused(capsys, "run", tmp_path / "no.toml", "-o", tmp_path / "out")
    assert code == 3
    assert "no.toml: no such file" in said


@pytest.mark.parametrize(
    ("key", "words"), [("uav1.json", "calib"), ("uav1-tracks.csv", "no such file"), ("uav1-poses.csv", "no such file")]
)
def test_missing_input_file(capsys, flight, key, words):
    (flight.parent / key).unlink()
    code, said = solve(capsys, flight)
    assert code == 3
    assert key in said
    assert words in said


def test_unknown_key(capsys, flight):
    edit(flight, "frame_rate", "framerate")
    code, said = solve(capsys, flight)
    assert code == 2
    assert "cameras.uav1.framerate: an unknown key" in said
    assert "did you mean 'frame_rate'?" in said


def test_unknown_key_as_json(capsys, flight):
    edit(flight, "frame_rate", "framerate")
    assert main(["solve", str(flight), "-o", str(flight.parent / "out"), "--json"]) == 2
    said = json.loads(capsys.readouterr().out)
    assert said["status"] == "error"
    assert said["exit_code"] == 2
    assert "framerate" in said["error"]["where"]


@pytest.mark.parametrize("file", ["uav1-tracks.csv", "uav1-poses.csv"])
@pytest.mark.parametrize("word", ["nan", "inf", "soon"])
def test_not_a_number_in_a_table(capsys, flight, file, word):
    table = flight.parent / file
    lines = table.read_text().splitlines()
    cells = lines[3].split(",")
    cells[-3] = word
    table.write_text("\n".join([*lines[:3], ",".join(cells), *lines[4:]]))
    code, said = solve(capsys, flight)
    assert code == 3
    assert file in said
    assert "4" in said


def test_empty_table(capsys, flight):
    (flight.parent / "uav2-tracks.csv").write_text("")
    code, said = solve(capsys, flight)
    assert code == 3
    assert "uav2-tracks.csv" in said


def test_zero_targets_in_common(capsys, flight):
    tracks = flight.parent / "uav2-tracks.csv"
    tracks.write_text(tracks.read_text().replace("target1", "lorry1").replace("target2", "lorry2"))
    code, said = solve(capsys, flight)
    assert code == 5
    assert "cameras.uav2" in said
    assert "at least one target in common" in said


def test_poses_of_other_frames(capsys, flight):
    poses = flight.parent / "uav2-poses.csv"
    head, *rows = poses.read_text().splitlines()
    poses.write_text("\n".join([head, *rows[:20]]))
    code, said = solve(capsys, flight)
    assert code == 3
    assert "frame" in said


def test_calibration_of_another_image_size(capsys, flight):
    lens = flight.parent / "uav1.json"
    content = json.loads(lens.read_text())
    content["image_size"] = [320, 180]
    lens.write_text(json.dumps(content))
    code, said = solve(capsys, flight)
    assert code == 3
    assert "320 x 180" in said


def test_a_calibration_without_an_image_size(capsys, flight):
    path = flight.parent / "uav1.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "image_size": None}))
    assert main(["solve", str(flight), "-o", str(flight.parent / "out"), "--quiet"]) == 0
    assert (flight.parent / "out/report.html").exists()


def test_truncated_calibration(capsys, flight):
    lens = flight.parent / "uav1.json"
    lens.write_text(lens.read_text()[:60])
    code, said = solve(capsys, flight)
    assert code == 3
    assert "uav1.json" in said


def test_an_output_folder_that_is_a_file(capsys, flight):
    out = flight.parent / "out"
    out.write_text("")
    code, said = refused(capsys, "solve", flight, "-o", out)
    assert code == 6
    assert str(out) in said


def test_no_command_prints_help_and_fails(capsys):
    assert main([]) == 2
    assert "COMMAND" in capsys.readouterr().err


def test_a_real_process_gives_the_same(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pipeline", "run", "no.toml", "-o", "out"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 3
    assert done.stderr.startswith("runningfix: no.toml: no such file")
    assert not (tmp_path / "out").exists()
