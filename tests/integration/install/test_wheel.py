"""The wheel: one package, whose every module loads and which runs a flight, with nothing of the source in reach."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy
import pytest

from scripts.wheel import rewritten
from tests.scenes.table_flight import write_table_flight

ROOT = Path(__file__).parents[3]
NEEDED = (
    "pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "calibration", "pipeline", "native",
    "runningfix", "scripts/wheel.py",
)  # fmt: skip
MODULE = re.compile(r"(calibration|pipeline)(\.[a-z_]\w*)+")
BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
LOAD_ALL = """
import importlib, pkgutil, sys, runningfix
for module in pkgutil.walk_packages(runningfix.__path__, "runningfix."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print([name for name in ("pipeline", "calibration") if name in sys.modules])
"""
PLAIN = """
import sys
sys.modules["numba"] = None  # nothing is compiled: as an install without the extra `fast`
from runningfix.__main__ import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    for name in NEEDED:
        source, copy = ROOT / name, folder / "source" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        else:
            shutil.copy(source, copy)
    build = [sys.executable, "-P", "-c", BUILD, str(folder)]
    subprocess.run(build, cwd=folder / "source", check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Runs Python on the unpacked wheel and what it depends on; no .pth file, so no editable install, takes part."""
    folder = tmp_path_factory.mktemp("installed")
    zipfile.ZipFile(wheel).extractall(folder)
    reach = os.pathsep.join([str(folder), str(Path(numpy.__file__).parents[1])])

    def python(*arguments, cwd=folder.parent):
        command = [sys.executable, "-S", "-P", *arguments]
        environment = {**os.environ, "PYTHONPATH": reach}
        return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)

    return python


def test_one_name_is_installed(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"runningfix"}
    assert {"runningfix/pipeline/report/report.css", "runningfix/py.typed"} <= set(names)
    (top_level,) = [zipfile.ZipFile(wheel).read(name) for name in names if name.endswith("top_level.txt")]
    assert top_level == b"runningfix\n"
    (entry,) = [zipfile.ZipFile(wheel).read(name) for name in names if name.endswith("entry_points.txt")]
    assert b"runningfix = runningfix.__main__:main" in entry


def test_every_module_loads_and_none_looks_for_the_source(installed):
    loaded = installed("-c", LOAD_ALL)
    assert loaded.returncode == 0, loaded.stderr
    assert loaded.stdout == "[]\n"


def test_a_flight_runs_far_from_the_source(installed, tmp_path):
    flight, _ = write_table_flight(tmp_path)
    done = installed("-c", PLAIN, "run", str(flight), "-o", "out", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "converged"
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_no_text_names_a_module_by_where_it_lies_in_the_source():
    named = []
    for package in ("calibration", "pipeline", "runningfix"):
        for path in (ROOT / package).rglob("*.py"):
            texts = (node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant))
            named += [(path.name, t) for t in texts if isinstance(t, str) and MODULE.fullmatch(t) and find_spec(t)]
    assert not named, "say __name__ or __package__: installed, it lies elsewhere"


def test_imports_are_rewritten_and_text_is_not():
    source = '"""from pipeline.cli import x"""\nif True:\n    from pipeline.cli import (\n        main,\n    )\n'
    source += "from calibration import Board\nfrom calibrations import y\nfrom .pipeline import z\nü = 'pipeline.cli'\n"
    expected = source.replace("    from pipeline", "    from runningfix.pipeline")
    assert rewritten(source) == expected.replace("\nfrom calibration ", "\nfrom runningfix.calibration ")


def test_an_import_that_would_bind_another_name_is_refused():
    with pytest.raises(ValueError, match="line 2: write `from"):
        rewritten("import os\nimport pipeline.cli\n")


def test_the_command_says_its_version(installed):
    assert installed("-m", "runningfix", "--version").stdout.startswith("runningfix 0.")
