"""The solver's loops both ways: built ahead of time, and compiled as they are called. The twins hold for each."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from calibration.foundation import prebuilt
from native import units
from pipeline.solver import how_compiled
from tests.scenes.solver import placed_model, rich_model
from tests.unit.native.conftest import built
from tests.unit.solver.adjustment import test_compiled_descent as descents
from tests.unit.solver.adjustment import test_kernels as kernels
from tests.unit.solver.offset_search import test_polynomial as search

ROOT = Path(__file__).parents[3]
ADJUSTMENT, SEARCH = units.LOOPS
TWINS = (
    "tests/unit/solver/adjustment/test_kernels.py", "tests/unit/solver/adjustment/test_compiled_descent.py",
    "tests/unit/solver/offset_search/test_polynomial.py",
)  # fmt: skip


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    """The extension, built of the source as it is now."""
    return built(units.written(ROOT, ADJUSTMENT), units.NAME, tmp_path_factory.mktemp("loops"))


@pytest.fixture
def ahead(loops, monkeypatch):
    """The solver on loops that were built ahead."""
    for name in dir(loops):
        module, _, function = name.partition(":")
        if function:
            monkeypatch.setattr(sys.modules[f"{ADJUSTMENT}.{module}"], function, getattr(loops, name))
    return loops


def test_the_twins_hold_ahead_of_time(ahead):
    for kinds, loss in (
        (("polynomial",), "none"),
        (("polynomial", "spline"), "cauchy"),
        (("spline", "spline"), "huber"),
    ):
        for pose_rate in (False, True):
            model, state = rich_model(kinds, loss, pose_rate=pose_rate)
            for frames in (model.frames, kernels.metric(model.frames)):
                kernels._both(kernels.changed(model, frames=frames), state)
    kernels._both(*placed_model(("polynomial", "spline"), "huber"))
    kernels.test_twins_where_cameras_stand_still()
    kernels.test_twins_without_prior_of_the_frames()
    kernels.test_poses_are_carried_alike()


def test_a_descent_takes_the_same_path_ahead_of_time(ahead):
    descents.test_the_same_path("map", "huber", (2.0, 1.0), False)
    descents.test_the_same_path("map", "cauchy", (0.0, 0.0), True)
    descents.test_poses_that_move_with_the_clocks_take_the_same_path(True)


@pytest.mark.skipif(how_compiled() != "ahead" or find_spec("numba") is None, reason="the twins were run so just now")
def test_the_twins_hold_when_compiled_as_they_are_called():
    run = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *TWINS]
    done = subprocess.run(run, cwd=ROOT, env={**os.environ, prebuilt.CHOICE: "jit"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]


def test_every_loop_that_python_calls_is_built(loops):
    names = {name for name in dir(loops) if ":" in name}
    wanted = {
        "_kernels:block_normals", "_kernels:kept_steps", "_kernels:squared_lengths", "_descent:folded",
        "_descent:damped_step", "_descent:tried", "_descent:localise", "_descent:motion_alone", "_assembly:assemble",
        "_band:inverse_band", "log_poses:_carry",
    }  # fmt: skip
    assert wanted <= names


def test_the_search_has_its_twin_ahead_of_time(tmp_path, monkeypatch):
    made = built(units.written(ROOT, SEARCH), units.NAME, tmp_path)
    monkeypatch.setattr(search.polynomial_polish, "frame_sums", getattr(made, "_frame_sums:frame_sums"))
    monkeypatch.setattr(search.polynomial_polish, "is_compiled", lambda _: True)
    search.test_compiled_sums_over_frames_are_those_of_the_plain_ones()


def test_loops_of_other_text_are_not_used(tmp_path):
    class Extension:
        __file__ = str(tmp_path / "_native.so")
        files = "one.py"

    (tmp_path / "one.py").write_text("first")
    before = prebuilt.stamp(Extension)
    (tmp_path / "one.py").write_text("second")
    assert prebuilt.stamp(Extension) != before
    (tmp_path / "one.py").unlink()
    assert prebuilt.stamp(Extension) == ""
