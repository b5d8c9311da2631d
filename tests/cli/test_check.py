"""`runningfix check`: doubts and errors in words, as JSON, and in the exit code."""

import json

import pytest

from pipeline.cli.main import main
from tests.scenes.table_flight import write_table_flight


@pytest.fixture
def flight(tmp_path):
    return write_table_flight(tmp_path)[0]


def check(capsys, flight):
    code = main(["check", str(flight), "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_nothing_speaks_against_a_good_flight(capsys, flight):
    assert main(["check", str(flight)]) == 0
    assert capsys.readouterr().out == "nothing speaks against this flight\n"
    code, said = check(capsys, flight)
    assert (code, said["status"], said["doubts"], said["errors"]) == (0, "done", [], [])
    assert not (flight.parent / "out").exists()


def test_all_that_is_wrong_is_told_at_once(capsys, flight):
    """Not the first mistake only: each costs its finder a round."""
    (flight.parent / "uav1.json").write_text("{}")
    text = flight.read_text().replace('"uav2-poses.csv"', '"uav1-poses.csv"')
    flight.write_text(text)
    code, said = check(capsys, flight)
    assert code == 3
    assert said["status"] == "error"
    assert "uav1.json" in said["errors"][0]["where"]
    assert [d["kind"] for d in said["doubts"]] == ["one-table-twice"]
    assert main(["check", str(flight)]) == 3
    words = capsys.readouterr().out
    assert words.count("refused ") == 2


def test_what_check_refuses_solve_refuses(capsys, flight):
    flight.write_text(flight.read_text().replace('"uav2-poses.csv"', '"uav1-poses.csv"'))
    code, said = check(capsys, flight)
    assert main(["solve", str(flight), "-o", str(flight.parent / "out")]) == code == 2
    assert said["doubts"][0]["seen"] in capsys.readouterr().err
    assert not (flight.parent / "out").exists()
