"""Every command, exit code, setting, output and extra is in the documentation, and the README stays short."""

import re
import tomllib
from pathlib import Path

import pytest

import runningfix
from calibration.foundation.errors import DID_NOT_CONVERGE, RunningFixError
from pipeline.cli import door
from pipeline.cli.parser import build_parser
from pipeline.export.exporters import EXPORTS
from pipeline.flight import read_flight

ROOT = Path(__file__).parents[2]
DOCS = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}
README = (ROOT / "README.md").read_text(encoding="utf-8")


def commands():
    parser = build_parser()
    return next(a for a in parser._actions if a.dest == "command").choices


@pytest.mark.parametrize("name", commands())
def test_every_command_is_documented(name):
    assert f"`runningfix {name} " in DOCS["commands"]


@pytest.mark.parametrize("name", commands())
def test_every_command_has_an_example_in_its_help(name):
    help_text = commands()[name].format_help()
    assert f"example:\n  runningfix {name}" in help_text


def test_the_documented_flight_file_is_read_whole(tmp_path):
    text = re.search(r"```toml\n(.*?)```", DOCS["flight-file"], re.DOTALL)[1]
    path = tmp_path / "flight.toml"
    path.write_text(re.sub(r"^(pose|height_m|east_m|north_m|up_m) = .*\n", "", text, flags=re.MULTILINE))
    read_flight(path)


def test_every_setting_is_in_the_documented_flight_file(tmp_path):
    example = re.search(r"```toml\n(.*?)```", DOCS["flight-file"], re.DOTALL)[1]
    camera = '[cameras.uav1]\ncalibration = "a"\n'
    for table in ("flight", "cameras.uav1", "cameras.uav1.sigma", "targets.car1", "ground", "landmarks.mast", "solve"):
        path = tmp_path / "flight.toml"
        header = "" if table == "cameras.uav1" else f"[{table}]\n"
        path.write_text(f"{camera}{header}not_a_setting = 1\n")
        with pytest.raises(Exception, match="one of") as caught:
            read_flight(path)
        for key in caught.value.expected.removeprefix("one of ").split(", "):
            assert re.search(rf"^(\[.*\b)?{key}\b", example, re.MULTILINE) or f".{key}]" in example, key


def test_every_extra_is_documented():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert not [name for name in extras if f"| `{name}` |" not in DOCS["install"]]


def test_every_name_of_the_package_is_documented():
    assert not [
        name for name in runningfix.__all__ if f"`{name}`" not in DOCS["python"] and f"rf.{name}" not in DOCS["python"]
    ]


def test_every_package_that_is_run_has_its_licence_told():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    ours = {
        name for name in project["optional-dependencies"] if name not in ("all", "docs", "mutation", "fuzz", "test")
    }
    named = [*project["dependencies"], *(d for name in ours for d in project["optional-dependencies"][name])]
    rows = re.findall(r"^\| ([\w-]+).*\| (.+) \| (.+) \|$", DOCS["licences"], re.MULTILINE)
    assert {re.match(r"[\w-]+", text)[0] for text in named} == {row[0] for row in rows} - {"package", "---"}


def test_the_wheel_is_installed_with_each_extra_that_users_have():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    installed = re.search(r'extras=\$\{\*:-"([a-z ]+)"\}', (ROOT / ".ci/install").read_text())[1].split()
    assert set(installed) == {"none", *extras} - {"docs", "mutation", "fuzz", "test"}


def test_every_exit_code_is_documented():
    known = {RunningFixError, *every_error(RunningFixError), door.InternalError, door.EndedByUserError}
    codes = {error.exit_code for error in known} | {0, DID_NOT_CONVERGE}
    sentence = re.search(r"Exit codes: (.*?)\.", DOCS["commands"], re.DOTALL)[1]
    assert {int(code) for code in re.findall(r"\b(\d+)\s[a-z]", sentence)} == codes


def every_error(kind):
    yield kind
    for below in kind.__subclasses__():
        yield from every_error(below)


def test_every_output_is_documented():
    rows = [line.split("|")[1] for line in DOCS["outputs"].splitlines() if line.startswith("| `")]
    for name in (*(exporter.file_name for exporter in EXPORTS), "tracks.csv", "poses.csv", "report.html"):
        assert any(f"`{name}`" in row or f"`.{name.rpartition('.')[2]}`" in row for row in rows), name


def test_the_readme_is_two_screens():
    assert len(README.split()) < 1300


@pytest.mark.parametrize(
    "source", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
)
def test_links_lead_somewhere(source):
    links = re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", source.read_text(encoding="utf-8"))
    assert not [link for link in links if not (source.parent / link).exists()]


def test_the_places_that_the_architecture_names_exist():
    places = re.findall(r"`((?:pipeline|calibration)/[\w/.]+)`", DOCS["architecture"])
    assert len(places) > 20
    assert not [place for place in places if not (ROOT / place).exists()]
    drawn = re.findall(r"^    ((?:\w+/)+\w*(?:\.py)?)\s", DOCS["architecture"], re.MULTILINE)
    assert len(drawn) > 20
    assert not [place for place in drawn if not ((ROOT / place).exists() or (ROOT / "pipeline" / place).exists())]


def test_every_doubt_is_documented():
    source = "".join(path.read_text() for path in (ROOT / "pipeline" / "stages" / "checks").glob("*.py"))
    kinds = set(re.findall(r'kind="([a-z-]+)"', source)) | {"latitude-longitude", "far-origin"}
    assert len(kinds) > 10
    assert not [kind for kind in kinds if f"`{kind}`" not in DOCS["commands"]]
