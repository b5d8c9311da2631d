"""Every command, exit code, setting and extra is in the README."""

import re
import tomllib
from pathlib import Path

import pytest

from pipeline.cli.parser import build_parser
from pipeline.flight import read_flight

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def commands():
    parser = build_parser()
    return next(a for a in parser._actions if a.dest == "command").choices


@pytest.mark.parametrize("name", commands())
def test_every_command_is_documented(name):
    assert f"`runningfix {name} " in README


@pytest.mark.parametrize("name", commands())
def test_every_command_has_an_example_in_its_help(name):
    help_text = commands()[name].format_help()
    assert f"example:\n  runningfix {name}" in help_text


def test_the_documented_flight_file_is_read_whole(tmp_path):
    text = re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1]
    path = tmp_path / "flight.toml"
    path.write_text(re.sub(r"^pose = .*\n", "", text, flags=re.MULTILINE))
    read_flight(path)


def test_every_setting_is_in_the_documented_flight_file(tmp_path):
    example = re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1]
    camera = '[cameras.uav1]\ncalibration = "a"\n'
    for table in ("flight", "cameras.uav1", "cameras.uav1.sigma", "targets.car1", "solve"):
        path = tmp_path / "flight.toml"
        header = "" if table == "cameras.uav1" else f"[{table}]\n"
        path.write_text(f"{camera}{header}not_a_setting = 1\n")
        with pytest.raises(Exception, match="one of") as caught:
            read_flight(path)
        for key in caught.value.expected.removeprefix("one of ").split(", "):
            assert re.search(rf"^(\[.*\b)?{key}\b", example, re.MULTILINE) or f".{key}]" in example, key


def test_every_extra_is_documented():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert not [name for name in extras if f"| `{name}` |" not in README]
