"""`import runningfix as rf`: every stage in a line, records that show themselves."""

import pydoc
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import runningfix as rf
from tests.scenes.table_flight import write_table_flight

DATA = Path(__file__).parents[3] / "data" / "flight"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("face")
    flight, truth = write_table_flight(folder)
    return flight, truth, folder / "out", rf.run(flight, folder / "out")


def test_every_name_is_there():
    assert [name for name in rf.__all__ if not callable(getattr(rf, name))] == []
    assert set(rf.__all__) <= set(dir(rf))
    with pytest.raises(AttributeError, match="no attribute 'slove'"):
        _ = rf.slove


def test_help_shows_the_way():
    said = pydoc.plain(pydoc.render_doc(rf))
    assert "rf.calibrate(" in said
    assert "rf.solve(" in said


def test_importing_is_quick_and_loads_nothing_heavy():
    code = "import sys, runningfix; print([n for n in ('cv2', 'scipy', 'pandas', 'matplotlib') if n in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_result_is_a_table_with_its_offsets_and_its_verdict(done):
    _, truth, _, result = done
    assert result.verdict in ("good", "care")
    assert result.to_dataframe().target.nunique() == 2
    offset = result.offsets().set_index("camera").loc["uav2"]
    assert abs(offset.offset_s - truth.offset_s["uav2"]) < 3 * offset.offset_sigma_s
    taken = result.corrections().set_index("parameter")
    assert taken.loc["uav2.offset_s" if "uav2.offset_s" in taken.index else "uav2.frame_rate"].sigma > 0
    assert np.allclose(taken.in_prior_sigmas, taken.value / taken.prior_sigma, rtol=0.02)
    assert result.verdict in repr(result)
    assert len(result.sightings()) == len(result.tracks().to_dataframe())
    assert {"refined_east_m", "qw"} <= set(result.poses().to_dataframe().columns)


def test_an_earlier_result_is_opened(done):
    _, _, out, result = done
    pd.testing.assert_frame_equal(rf.open_results(out).to_dataframe(), result.to_dataframe())
    with pytest.raises(rf.RunningFixError, match=r"no solution\.json"):
        rf.open_results(out / "nothing")


def test_the_stages_one_by_one_give_the_same(done, tmp_path):
    flight, _, _, result = done
    assert len(rf.track(flight, tmp_path).to_dataframe()) == len(result.tracks().to_dataframe())
    assert len(rf.poses(str(flight), tmp_path).to_dataframe()) > 0
    again = rf.solve(rf.read_flight(flight), tmp_path)
    pd.testing.assert_frame_equal(again.to_dataframe(), result.to_dataframe())


def test_another_method_and_one_that_is_none(done, tmp_path):
    assert rf.run(done[0], tmp_path, method="intersection").solution["method"] == "intersection"
    with pytest.raises(rf.RunningFixError, match="one of triangulation"):
        rf.run(done[0], tmp_path, method="guess")


def test_doubts_before_tracking(done):
    found = rf.check(done[0])
    assert not found.stops
    assert list(found.to_dataframe().columns) == ["certain", "where", "seen", "expected", "advice"]
    assert repr(found)


def test_a_log_is_a_table_in_degrees():
    table = rf.read_log(DATA / "uav1.tlog").to_dataframe()
    assert table.latitude_deg.between(-90, 90).all()
    assert np.all(np.diff(table.time_s) >= 0)


def test_progress_is_told_to_a_listener(done, tmp_path):
    told = []
    rf.run(done[0], tmp_path, progress=lambda stage, done, total: told.append(stage))
    assert "solve" in told


def test_every_record_draws_itself_on_the_callers_axes(done):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from matplotlib.figure import Figure

    result = done[3]
    for record in (result, result.tracks(), result.poses(), rf.check(done[0]), rf.read_log(DATA / "uav1.tlog")):
        axes = Figure().subplots()
        assert record.plot(axes) is axes
    axes = Figure().subplots()
    result.plot(axes)
    assert len(axes.lines) == 2
    assert axes.get_xlabel() == "east (m)"
    assert axes.patches, "one-sigma ellipses"


def test_photos_become_a_camera(tmp_path):
    found = rf.calibrate(str(DATA / "board-uav1" / "*.jpg"), board="9x6", square_mm=25, output=tmp_path / "uav1.json")
    assert len(found.to_dataframe()) == len(found.calibration.views)
    assert found.verdict in ("good", "usable")
    assert rf.read_camera(tmp_path / "uav1.json").image_size == found.camera.image_size
