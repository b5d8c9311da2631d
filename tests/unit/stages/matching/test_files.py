"""A flight file with new targets is the user's in every other character; nothing of the user's is written over."""

import tomllib

import pytest

from calibration.foundation.errors import UsageError, WriteError
from pipeline.flight import flight_of
from pipeline.matching import TrackName
from pipeline.records import Box
from pipeline.stages.matching.files import matched_paths, matched_text

TEXT = """# my flight
[cameras.a]
calibration = "a.json"   # calibrated in May
tracks = "a.csv"  # by hand

[cameras.b]
calibration = "b.json"
video = "b.mp4"

# the red one
[targets.car]
order = 2
boxes.b = { frame = 3, box = [1, 2, 30, 40] }

[solve]
rate_hz = 5
"""


@pytest.fixture
def flight(tmp_path):
    path = tmp_path / "flight.toml"
    path.write_text(TEXT)
    return flight_of(TEXT.encode(), path)


def test_only_targets_and_tracks_change(flight):
    names = {TrackName(camera="a", target="7"): "7", TrackName(camera="b", target="car"): "7"}
    boxes = {TrackName(camera="b", target="car"): Box(frame=3, x=1, y=2, width=30, height=40)}
    text = matched_text(TEXT, flight, boxes, names, matched_paths(flight, None), {"7": ["matched: a:7 = b:car"]})
    found = tomllib.loads(text)
    assert found["cameras"]["a"]["tracks"] == "a-matched.csv"
    assert found["targets"] == {"7": {"boxes": {"b": {"frame": 3, "box": [1, 2, 30, 40]}}, "order": 2}}
    assert found["solve"] == {"rate_hz": 5}
    assert "# my flight" in text
    assert "# calibrated in May" in text
    assert "# by hand" in text
    assert "# the red one" not in text
    assert "# matched: a:7 = b:car" in text


def test_several_boxes_of_a_target_stay(flight):
    two = "[{ frame = 3, box = [1, 2, 30, 40] }, { frame = 9, box = [2, 2, 30, 40] }]"
    text = TEXT.replace("{ frame = 3, box = [1, 2, 30, 40] }", two)
    names = {TrackName(camera="b", target="car"): "car"}
    boxes = {TrackName(camera="b", target="car"): Box(frame=3, x=1, y=2, width=30, height=40)}
    found = tomllib.loads(matched_text(text, flight, boxes, names, matched_paths(flight, None), {}))
    assert [box["frame"] for box in found["targets"]["car"]["boxes"]["b"]] == [3, 9]


@pytest.mark.parametrize("name", ["flight-matched.toml", "a-matched.csv"])
def test_a_file_that_is_there_stays(flight, name):
    (flight.path.parent / name).write_text("mine")
    with pytest.raises(WriteError, match="nothing of yours is written over"):
        matched_paths(flight, None)


def test_another_folder_is_refused(flight, tmp_path):
    with pytest.raises(WriteError, match="relative"):
        matched_paths(flight, tmp_path / "elsewhere" / "new.toml")


def test_targets_that_cannot_be_edited_are_refused(flight, tmp_path):
    text = TEXT.replace("# the red one\n[targets.car]\norder = 2\nboxes.b", "targets = { car = { boxes = {} } }\n#")
    text = "targets = { car = { order = 1 } }\n" + TEXT.split("# the red one")[0]
    with pytest.raises(UsageError, match="not edited here"):
        matched_text(text, flight, {}, {TrackName(camera="a", target="1"): "1"}, matched_paths(flight, None), {})
