"""Which files there are, why some are not, and that writing is whole."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from calibration.foundation.errors import WriteError
from pipeline.export import EXPORTS, export_all, not_exported, write_exports
from tests.scenes.export import tiny_results

ON_THE_MAP = ("geojson", "kml", "czml", "gpx", "gpkg", "waypoints")
MAPS = {f"trajectory.{suffix}" for suffix in ON_THE_MAP}
OTHERS = {f"trajectory-van__1_____co___Z_rich.{suffix}" for suffix in ("tum", "waypoints")}


def test_every_file_of_a_flight_on_the_map() -> None:
    files = export_all(tiny_results())
    assert {e.file_name for e in EXPORTS} <= set(files)
    assert set(files) - {e.file_name for e in EXPORTS} == OTHERS
    assert not_exported(tiny_results()) == {}


def test_off_the_map_the_map_formats_are_left_out_with_the_reason() -> None:
    results = tiny_results(origin=None)
    assert MAPS.isdisjoint(export_all(results))
    missing = not_exported(results)
    assert set(missing) == MAPS
    assert all("origin" in why for why in missing.values())


def test_what_does_not_apply_says_so() -> None:
    results = tiny_results(trajectories=())
    steady = dataclasses.replace(results.solution, clocks=results.solution.clocks[:1])
    missing = not_exported(dataclasses.replace(results, solution=steady))
    assert missing.pop("trajectory.parquet").startswith("no target has a trajectory, or pyarrow is not installed")
    assert missing.pop("clock.csv") == "no clock drifts"
    assert missing == dict.fromkeys(("trajectory.tum", "trajectory.waypoints"), "no target has a trajectory")


def test_without_pyarrow_there_is_no_parquet_and_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.export.tables.as_geoparquet.find_spec", lambda name: None)
    assert "trajectory.parquet" not in export_all(tiny_results())
    assert "pip install 'runningfix[parquet]'" in not_exported(tiny_results())["trajectory.parquet"]


def test_same_results_same_bytes() -> None:
    assert export_all(tiny_results()) == export_all(tiny_results())


def test_writing_takes_away_what_belongs_to_another_answer(tmp_path: Path) -> None:
    out = tmp_path / "out"
    written = write_exports(tiny_results(), out)
    assert {p.name for p in written} == {p.name for p in out.iterdir()} == set(export_all(tiny_results()))
    assert (out / "trajectory.kml").read_text(encoding="utf-8") == export_all(tiny_results())["trajectory.kml"]
    write_exports(tiny_results(origin=None), out)
    assert MAPS.isdisjoint(p.name for p in out.iterdir())


def test_a_folder_that_cannot_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file, not a folder")
    with pytest.raises(WriteError, match="cannot be written"):
        write_exports(tiny_results(), tmp_path / "out")
