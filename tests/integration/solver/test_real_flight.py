"""The real flight of four cameras that were never synchronised, against RTK."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cli.main import main

SHARED = Path(__file__).parents[4] / "shared"
FLIGHT = SHARED / "real" / "multicam" / "flight1"
SCORE = SHARED / "tools" / "score_multicam.py"

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not (FLIGHT.exists() and SCORE.exists()), reason="the real flights are not beside the project"),
]


def test_flight1_from_nothing_known_of_the_clocks(tmp_path):
    assert main(["solve", str(FLIGHT / "flight.toml"), "-o", str(tmp_path), "--quiet"]) == 0
    scored = subprocess.run(
        [sys.executable, str(SCORE), str(FLIGHT), str(tmp_path)], check=True, capture_output=True, text=True
    )
    found = json.loads(scored.stdout)
    assert found["absolute"]["rmse_m"] < 0.15
    assert found["aligned"]["rmse_m"] < 0.06
    assert max(abs(ms) for ms in found["clock_error_ms"].values()) < 30
    assert max(abs(found["clock_error_ms"][c]) for c in ("cam2", "cam3")) < 6
    assert found["scored"] == "646 of 646"
