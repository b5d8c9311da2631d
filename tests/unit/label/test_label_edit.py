"""Boxes in and out of the text of a flight file: what was asked changes, nothing else does."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.foundation.errors import UsageError
from pipeline.label import boxes_swapped, with_box, without_box
from pipeline.records import Box

TEXT = """# my flight
[flight]
title = "Convoy"    # a comment

[cameras.uav1]
calibration = "a.json"
video = 'a.mp4'

[targets.car1]   # the red one
motion = "spline"
boxes.uav1 = { frame = 0, box = [612, 340, 24, 18] }   # drawn by hand
boxes."uav 2" = { frame = 3, box = [1, 2, 30, 40] }

[targets."big truck".boxes]
uav1 = { frame = 7, box = [5.5, 6, 20, 20] }

[solve]
method = "map"
"""
BOX = Box(frame=12, x=10.5, y=20, width=30, height=25.25)
VALUE = "{ frame = 12, box = [10.5, 20, 30, 25.25] }"


@pytest.mark.parametrize(
    ("target", "camera", "old", "new"),
    [
        ("car1", "uav1", "{ frame = 0, box = [612, 340, 24, 18] }", VALUE),
        ("car1", "uav 2", "{ frame = 3, box = [1, 2, 30, 40] }", VALUE),
        ("big truck", "uav1", "{ frame = 7, box = [5.5, 6, 20, 20] }", VALUE),
    ],
)
def test_a_box_is_corrected_where_it_stands(target, camera, old, new):
    assert with_box(TEXT, target, camera, BOX) == TEXT.replace(old, new)


def test_a_new_box_goes_to_its_targets_others():
    text = with_box(TEXT, "big truck", "uav 2", BOX)
    assert text == TEXT.replace("20, 20] }\n", f'20, 20] }}\n"uav 2" = {VALUE}\n')


def test_a_new_target_goes_to_the_end():
    assert with_box(TEXT, "target2", "uav1", BOX) == TEXT + f"\n[targets.target2]\nboxes.uav1 = {VALUE}\n"
    assert with_box("a = 1", "ü", "c", BOX) == f'a = 1\n\n[targets."ü"]\nboxes.c = {VALUE}\n'


def test_deleting_leaves_the_rest():
    assert without_box(TEXT, "car1", "uav1") == "".join(
        line for line in TEXT.splitlines(keepends=True) if "drawn by hand" not in line
    )
    gone = without_box(TEXT, "big truck", "uav1")
    assert "big truck" not in gone
    assert gone == TEXT.replace('[targets."big truck".boxes]\nuav1 = { frame = 7, box = [5.5, 6, 20, 20] }\n\n', "")


def test_targets_change_places_in_one_camera():
    text = boxes_swapped(TEXT, "uav1", "car1", "big truck")
    found, before = tomllib.loads(text)["targets"], tomllib.loads(TEXT)["targets"]
    assert found["car1"]["boxes"]["uav1"] == before["big truck"]["boxes"]["uav1"]
    assert found["big truck"]["boxes"]["uav1"] == before["car1"]["boxes"]["uav1"]
    assert found["car1"]["boxes"]["uav 2"] == before["car1"]["boxes"]["uav 2"]
    moved = tomllib.loads(boxes_swapped(TEXT, "uav 2", "car1", "new"))["targets"]
    assert moved["new"]["boxes"] == {"uav 2": before["car1"]["boxes"]["uav 2"]}
    assert "uav 2" not in moved["car1"]["boxes"]


def test_windows_line_ends_stay():
    text = with_box(TEXT.replace("\n", "\r\n"), "new", "uav1", BOX)
    assert "\n" not in text.replace("\r\n", "")


@pytest.mark.parametrize(
    "text",
    [
        "[targets.car1]\nboxes = { uav1 = { frame = 0, box = [1, 2, 30, 40] } }\n",
        "[targets.car1]\nboxes.uav1 = { frame = 0, box = [1, 2,\n 30, 40] }\n",
        "[targets.car1.boxes.uav1]\nframe = 0\nbox = [1, 2, 30, 40]\n",
        "targets.car1.boxes.uav1 = { frame = 0, box = [1, 2, 30, 40] }\n",
    ],
)
@pytest.mark.parametrize("edit", [lambda t: with_box(t, "car1", "uav1", BOX), lambda t: without_box(t, "car1", "uav1")])
def test_what_is_not_on_a_line_of_its_own_is_refused(text, edit):
    with pytest.raises(UsageError, match="by hand"):
        edit(text)


NAMES = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), min_size=1, max_size=8)
SIDES = st.floats(0, 4000).map(lambda v: round(v, 1))


@settings(max_examples=40, deadline=None)
@given(NAMES, NAMES, st.tuples(SIDES, SIDES, SIDES, SIDES), st.integers(0, 10**6))
def test_any_name_comes_back(target, camera, sides, frame):
    x, y, width, height = sides
    box = Box(frame=frame, x=x, y=y, width=width, height=height)
    text = with_box(TEXT, target, camera, box)
    assert tomllib.loads(text)["targets"][target]["boxes"][camera] == {"frame": frame, "box": list(sides)}
    assert tomllib.loads(without_box(text, target, camera)).get("flight") == {"title": "Convoy"}
