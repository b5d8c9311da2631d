"""From the flight file to the verdict: readouts that are given, refined, left out, or cannot be."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibration.foundation.errors import UsageError
from pipeline.export.as_json import solution_json
from pipeline.flight import read_flight
from pipeline.stages import run_solve
from scripts.validation.drawn_flights import write
from scripts.validation.drawn_shutters import shuttered

READOUT_S = 0.02


def drawn(folder: Path, *, readout_s=READOUT_S, given=None, loose=None, method="map"):
    """A flight of two swinging cameras with RTK, read out in 20 ms, with what is told of that."""
    flight = shuttered(1, readout_s, grade="rtk", targets=3, length_s=5.0)
    flight.told_targets = {name: {"motion": "polynomial", "order": 4} for name in flight.motions}
    for cam in flight.cameras:
        cam.told |= {} if given is None else {"readout_s": given}
        cam.told_sigma |= {} if loose is None else {"readout_s": loose}
    path = write(flight, folder)
    path.write_text(path.read_text().replace("[solve]", f'[solve]\nmethod = "{method}"'))
    return path, flight


def apart_m(one, other):
    """Root mean square distance of two flights' trajectories."""
    pairs = zip(one.trajectories, other.trajectories, strict=True)
    return np.sqrt(np.mean([((a.position_enu_m - b.position_enu_m) ** 2).sum(axis=1).mean() for a, b in pairs]))


def solved(folder: Path, **told):
    path, flight = drawn(folder, **told)
    return run_solve(read_flight(path), folder / "out").results, flight


def test_a_refined_readout_is_found_and_told(tmp_path):
    results, _ = solved(tmp_path, loose=0.03)
    assert results.solution.verdict.grade == "good"
    for bias in results.solution.biases:
        assert abs(bias.readout_s - READOUT_S) < 3 * bias.readout_sigma_s
        assert 0 < bias.readout_sigma_s < 0.01
    written = json.loads((tmp_path / "out" / "solution.json").read_text())
    assert written["biases"][0]["readout_s"] == pytest.approx(results.solution.biases[0].readout_s, rel=1e-6)
    assert "uav1.readout_s" in written["shared"]["names"]
    table = pd.read_csv(tmp_path / "out" / "sightings.csv")
    of = table[table.camera == "uav1"]
    late = of.time_s - of.frame / next(c for c in results.solution.clocks if c.camera == "uav1").frame_rate
    assert late.abs().max() < 0.6 * READOUT_S
    assert late.abs().max() > 1e-3  # each is told at its own row's time


def test_one_that_is_left_out_is_named_first(tmp_path):
    results, _ = solved(tmp_path)
    first = results.solution.verdict.reasons[0]
    assert first.kind == "rolling-shutter"
    assert "readout_s" in first.advice
    found = [float(ms) for ms in re.findall(r"([\d.]+) ms of uav", first.words)]
    assert found == pytest.approx([20.0, 20.0], abs=4.0)
    assert "readout_s" not in json.loads(solution_json(results))["biases"][0]


@pytest.mark.parametrize(("method", "share"), [("intersection", 0.05), ("triangulation", 0.5)])
def test_every_method_takes_a_given_readout(tmp_path, method, share):
    """As a global shutter would have had it; triangulation knows how the cameras turn, and nothing else."""
    told, _ = solved(tmp_path / "told", given=READOUT_S, method=method)
    ignored, _ = solved(tmp_path / "ignored", method=method)
    at_once, _ = solved(tmp_path / "global", readout_s=0.0, method=method)
    assert apart_m(told, at_once) < share * apart_m(ignored, at_once)


@pytest.mark.parametrize(("given", "words"), [(0.05, "from frame to frame"), (16.0, "0.2")])
def test_readouts_that_cannot_be_are_refused(tmp_path, given, words):
    path, _ = drawn(tmp_path, given=given)
    with pytest.raises(UsageError, match="readout_s") as refused:
        run_solve(read_flight(path), tmp_path / "out")
    assert words in str(refused.value)


def test_a_readout_needs_the_picture_s_height(tmp_path):
    path, flight = drawn(tmp_path, given=READOUT_S)
    for cam in flight.cameras:
        file = tmp_path / f"{cam.name}.json"
        model = json.loads(file.read_text())
        del model["image_size"]
        file.write_text(json.dumps(model))
    with pytest.raises(UsageError, match="image_size"):
        run_solve(read_flight(path), tmp_path / "out")
