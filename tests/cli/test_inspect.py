"""`runningfix inspect` says what is in a log, draws it, and keeps standard output for results."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pipeline.cli.main import main

LOG = Path(__file__).parents[2] / "data" / "flight" / "uav1.tlog"


def test_words_and_picture(tmp_path, capsys):
    picture = tmp_path / "uav1.svg"
    assert main(["inspect", str(LOG), "-o", str(picture)]) == 0
    said = capsys.readouterr().out
    for part in ("2244 messages", "GLOBAL_POSITION_INT, 150 of 150", "undulation by the log's own", "camera events"):
        assert part in said
    root = ElementTree.parse(picture).getroot()
    text = "".join(root.itertext())
    for part in ("Way flown", "Height", "Attitude of the vehicle", "Attitude of the gimbal"):
        assert part in text


def test_json_is_alone_on_standard_output(capsys):
    assert main(["inspect", str(LOG), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["status"], found["messages"], found["corrupt_packets"]) == ("done", 2244, 0)
    assert [one["what"] for one in found["series"]] == ["position", "attitude", "gimbal"]


def test_a_log_that_is_none_and_a_vehicle_that_is_not_there(tmp_path, capsys):
    (tmp_path / "a.tlog").write_bytes(b"no log at all")
    assert main(["inspect", str(tmp_path / "a.tlog")]) == 3
    assert main(["inspect", str(LOG), "--system", "9"]) == 3
    assert "systems in it: [1]" in capsys.readouterr().err


def test_a_log_without_anything_is_still_drawn(tmp_path, capsys):
    (tmp_path / "a.srt").write_text("1\n00:00:01,000 --> 00:00:02,000\nnothing\n")
    assert main(["inspect", str(tmp_path / "a.srt"), "-o", str(tmp_path / "a.svg")]) == 0
    assert "missing: GPS or latitude" in capsys.readouterr().out
    assert "no position and no attitude" in (tmp_path / "a.svg").read_text()


@pytest.mark.parametrize("loud", ["--quiet", "--verbose"])
def test_quiet_and_verbose(loud, capsys):
    assert main(["inspect", str(LOG), loud]) == 0
    said = capsys.readouterr().out
    assert (said == "") == (loud == "--quiet")
    assert ("SERVO_OUTPUT_RAW" in said) == (loud == "--verbose")
