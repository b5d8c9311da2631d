"""Faults of an installation are found and named with what mends them; the self-test notices wrong answers."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from pipeline.cli.main import main
from pipeline.doctor import installation as looks
from pipeline.doctor import self_test

WHOLE = dict.fromkeys(looks.NEEDED, "1.0")


def test_one_opencv_package_is_right_and_two_are_not():
    assert looks.one_opencv(WHOLE).state == "good"
    found = looks.one_opencv(WHOLE | {"opencv-python": "4.10"})
    assert found.state == "wrong"
    assert "opencv-python 4.10" in found.seen
    assert "pip uninstall -y opencv-python opencv-contrib-python-headless" in found.advice


def test_without_opencv_nothing_is_uninstalled():
    found = looks.one_opencv({})
    assert (found.state, "uninstall" in found.advice) == ("wrong", False)


def test_missing_packages_are_wrong_and_missing_extras_only_absent():
    assert [one.name for one in looks.needed(WHOLE) if one.state == "wrong"] == []
    assert [one.name for one in looks.needed({}) if one.state == "wrong"] == list(looks.NEEDED)
    absent = {one.name: one for one in looks.extras(WHOLE)}
    assert absent["extra ulog"].state == "absent"
    assert absent["extra ulog"].advice == "pip install 'runningfix[ulog]'"


def test_a_folder_that_cannot_be_written_is_told(monkeypatch):
    monkeypatch.setattr(looks, "_can_write", lambda folder: False)
    temporary, code = looks.writable()
    assert (temporary.state, code.state) == ("wrong", "absent")
    assert "NUMBA_CACHE_DIR" in code.advice


def test_everything_that_is_needed_is_looked_for():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    assert {re.match(r"[\w-]+", line)[0] for line in project["dependencies"]} == set(looks.NEEDED)
    ours = {"all", "test", "docs", "fuzz", "mutation"}
    assert set(project["optional-dependencies"]) - ours == set(looks.EXTRAS)


@pytest.mark.parametrize(
    ("how", "state", "said"), [("ahead", "good", ""), ("when called", "good", "--warm"), ("no", "absent", "C compiler")]
)
def test_how_loops_are_compiled_is_told(how, state, said):
    found = looks.compiled_loops(how)
    assert found.state == state
    assert said in found.advice


def test_compiling_ahead_is_done_when_asked(monkeypatch, capsys):
    monkeypatch.setattr(looks, "versions", lambda: WHOLE)
    asked = []
    monkeypatch.setattr("pipeline.cli.doctor.make_ready", asked.append)
    assert main(["doctor", "--quick"]) == 0
    assert not asked
    assert main(["doctor", "--quick", "--warm"]) == 0
    assert len(asked) == 1


def test_this_opencv_has_its_parts():
    assert looks.opencv_builds().state == "good"


@pytest.mark.parametrize("name", self_test.TRIALS)
def test_every_task_comes_out_right_here(name):
    right, seen = self_test.TRIALS[name]()
    assert right, seen


def test_a_solver_that_claims_too_much_is_noticed(monkeypatch):
    monkeypatch.setattr(self_test, "CLAIMS", 1e-3)
    assert not self_test.solver()[0]


def test_a_task_that_raises_is_wrong_and_the_others_are_done(monkeypatch):
    def broken():
        raise ImportError("no such thing")

    monkeypatch.setattr(self_test, "TRIALS", {"tracking": broken, "log": self_test.log})
    first, second = self_test.tried()
    assert (first.right, first.seen, second.right) == (False, "ImportError: no such thing", True)


def test_the_command_says_what_is_wrong_and_exits_1(monkeypatch, capsys):
    monkeypatch.setattr(looks, "versions", lambda: WHOLE | {"opencv-python": "4.10"})
    assert main(["doctor", "--quick", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in told["installation"] if one["state"] == "wrong"] == ["one OpenCV"]
    assert main(["doctor", "--quick"]) == 1
    assert "wrong: one OpenCV" in capsys.readouterr().out


def test_the_command_exits_0_where_all_is_well(monkeypatch, capsys):
    monkeypatch.setattr(looks, "versions", lambda: WHOLE)
    assert main(["doctor", "--quick"]) == 0
    assert capsys.readouterr().out.rstrip().endswith("nothing is wrong")
