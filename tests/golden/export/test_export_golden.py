"""Every format of a tiny flight, byte for byte.

After a wanted change: RUNNINGFIX_UPDATE_GOLDEN=1 pytest tests/golden/export, and read the difference.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pipeline.export import export_all, poses_csv, tracks_csv
from tests.scenes.export import poses, tiny_results, tracks

EXPECTED = Path(__file__).parent / "expected"
FILES = {
    **{name: text for name, text in export_all(tiny_results()).items() if isinstance(text, str)},
    "tracks.csv": tracks_csv(tracks()),
    "poses.csv": poses_csv(poses()),
    "poses-refined.csv": poses_csv(poses(), poses(0.25)),
    "no-utc/trajectory.kml": export_all(tiny_results(utc_s=None))["trajectory.kml"],
    "no-utc/trajectory.czml": export_all(tiny_results(utc_s=None))["trajectory.czml"],
    "no-origin/trajectory.csv": export_all(tiny_results(origin=None, utc_s=None))["trajectory.csv"],
}


@pytest.mark.parametrize("name", sorted(FILES))
def test_file_is_what_it_was(name: str) -> None:
    path = EXPECTED / name
    if os.environ.get("RUNNINGFIX_UPDATE_GOLDEN"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(FILES[name].encode())
    assert FILES[name] == path.read_bytes().decode()


def test_nothing_expected_is_missing() -> None:
    assert {p.relative_to(EXPECTED).as_posix() for p in EXPECTED.rglob("*.*") if p.is_file()} == set(FILES)
