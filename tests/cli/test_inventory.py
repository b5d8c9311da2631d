"""The inventory of what is installed: it says what is unpinned, other or of an untold licence, and asks nobody."""

from pathlib import Path

from scripts.inventory import Package, amiss, installed, pins

ROOT = Path(__file__).parents[2]
TOLD = "| numpy (and of-it) | BSD-3-Clause | always |"


def package(name="numpy", version="1.0", *, used=True):
    return {name: Package(name=name, version=version, licence="MIT", used=used)}


def test_pins_are_read_by_the_name_that_they_are_known_under():
    assert pins("# a comment\nNumPy==1.0\nof_it==2.0.post1 ; python_version < '4'\n") == {
        "numpy": "1.0",
        "of-it": "2.0.post1",
    }


def test_what_is_amiss_is_said():
    assert amiss(package() | package("of-it", "2"), {"numpy": "1.0", "of-it": "2"}, TOLD) == []
    assert amiss(package(), {}, TOLD) == ["numpy 1.0 is not pinned in scripts/constraints.txt"]
    assert amiss(package(), {"numpy": "1.1"}, TOLD) == ["numpy 1.0 is installed, 1.1 is pinned"]
    assert amiss(package("other"), {"other": "1.0"}, TOLD) == ["other (MIT) is not in docs/licences.md"]
    assert amiss(package("other", used=False), {"other": "1.0"}, TOLD) == []


def test_what_others_bring_is_found():
    found = installed(["pandas>=1", "of-none-of-this-name"], used=True)
    assert {"pandas", "numpy", "python-dateutil", "six"} <= set(found)
    assert "pytest" not in found, "an extra of theirs that nobody asked for"
    assert all(one.version and one.licence for one in found.values())


def test_the_licence_of_everything_that_is_installed_here_for_users_is_told():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = project["optional-dependencies"]
    named = [
        *project["dependencies"],
        *(text for name in ("fast", "geoid", "cluster", "terrain") for text in optional[name]),
    ]
    packages, told = installed(named, used=True), (ROOT / "docs/licences.md").read_text()
    assert not [said for said in amiss(packages, {}, told) if "licences.md" in said]
