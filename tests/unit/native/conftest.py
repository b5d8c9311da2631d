"""Loops translated and built in a folder of their own."""

import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from native.translate import Program, read_unit
from native.units import FLAGS
from native.wrappers import c_file


def compiler():
    """The C compiler's words, or a skip."""
    if os.name != "posix":
        pytest.skip("built here on POSIX systems only")
    words = (sysconfig.get_config_var("CC") or "cc").split()
    if subprocess.run(["which", words[0]], capture_output=True).returncode:
        pytest.skip("no C compiler here")
    return words


def built(text: str, name: str, folder: Path):
    """The extension of a C text, imported."""
    source, out = folder / f"{name}.c", folder / f"{name}{sysconfig.get_config_var('EXT_SUFFIX')}"
    source.write_text(text)
    shared = ["-bundle", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared"]
    include = sysconfig.get_path("include")
    subprocess.run(
        [*compiler(), *FLAGS, "-fPIC", *shared, f"-I{include}", str(source), "-o", str(out), "-lm"], check=True
    )
    spec = importlib.util.spec_from_file_location(name, out)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def translated(tmp_path):
    """Python text -> the functions built of it, by name."""

    def make(text: str):
        path = tmp_path / "loops.py"
        path.write_text(text)
        extension = built(c_file(Program({"loops": read_unit(path)}), "made", "stamp", ""), "made", tmp_path)
        return lambda name: getattr(extension, f"loops:{name}")

    return make
