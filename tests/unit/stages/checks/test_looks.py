"""Boxes of another video and names that are exchanged are seen in the pictures; ordinary boxes are not doubted."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.flight import Flight, read_flight
from pipeline.records import Box
from pipeline.stages.checks.looks import CLEAR, DULL, look_doubts, standing_out
from tests.scenes.video import written

COLOURS = {"red": (40, 40, 200), "blue": (200, 70, 40), "white": (225, 225, 225)}
PLACES = {
    "a": {"red": (20, 30), "blue": (90, 40), "white": (60, 80)},
    "b": {"red": (110, 70), "blue": (30, 85), "white": (70, 20)},
}


def filmed(folder: Path, *, brighter: float = 1.0) -> None:
    """Two videos of three patches on rough ground, each camera's patches elsewhere; the second camera is `brighter`."""
    rng = np.random.default_rng(0)
    for name, places in PLACES.items():
        ground = cv2.resize(rng.integers(70, 120, (30, 40, 1), np.uint8), (160, 120))[..., None].repeat(3, axis=2)
        for colour, (x, y) in places.items():
            ground[y : y + 12, x : x + 16] = COLOURS[colour]
        gain = brighter if name == "b" else 1.0
        written(folder / f"{name}.avi", [np.clip(ground * gain, 0, 255).astype(np.uint8)] * 6)


def flight(folder: Path, boxes: dict[str, dict[str, str]]) -> Flight:
    """Target names with the colour that each camera's box is drawn around; "a's red" is that place in any video."""
    text = ""
    for name in PLACES:
        text += f'[cameras.{name}]\ncalibration = "{name}.json"\nvideo = "{name}.avi"\n'
    for target, drawn in boxes.items():
        text += f"[targets.{target}]\n"
        for camera, colour in drawn.items():
            of, patch = colour.split("'s ") if "'s " in colour else (camera, colour)
            x, y = PLACES[of][patch]
            text += f"boxes.{camera} = {{ frame = 3, box = [{x}, {y}, 16, 12] }}\n"
    (folder / "flight.toml").write_text(text)
    return read_flight(folder / "flight.toml")


RIGHT = {colour: {"a": colour, "b": colour} for colour in COLOURS}


@pytest.mark.parametrize("brighter", [1.0, 0.85])
def test_right_boxes_are_not_doubted(tmp_path, brighter):
    filmed(tmp_path, brighter=brighter)
    assert look_doubts(flight(tmp_path, RIGHT)) == []


@pytest.mark.parametrize("brighter", [1.0, 0.85])
def test_two_names_that_are_exchanged_in_one_camera_are_named(tmp_path, brighter):
    filmed(tmp_path, brighter=brighter)
    exchanged = {"red": {"a": "red", "b": "blue"}, "blue": {"a": "blue", "b": "red"}}
    (doubt,) = look_doubts(flight(tmp_path, RIGHT | exchanged))
    assert doubt.kind == "targets-exchanged"
    assert doubt.subject == ("a", "b", "red", "blue")
    assert not doubt.certain


def test_boxes_of_another_video_are_said(tmp_path):
    filmed(tmp_path)
    found = look_doubts(flight(tmp_path, RIGHT | {"red": {"a": "b's red", "b": "red"}}))
    assert [(d.kind, d.subject) for d in found] == [("box-of-another-video", ("a", "red"))]


def test_what_stands_out_is_measured_in_spreads_of_its_surroundings():
    rng = np.random.default_rng(1)
    shown = rng.integers(90, 110, (60, 80, 3)).astype(np.uint8)
    box = Box(frame=0, x=30, y=20, width=16, height=12)
    assert standing_out(shown, box) < DULL
    shown[20:32, 30:46] = (200, 128, 128)
    assert standing_out(shown, box) > CLEAR
    assert np.isnan(standing_out(shown, Box(frame=0, x=90, y=20, width=3, height=12)))


def test_videos_that_cannot_be_read_say_nothing(tmp_path):
    found = flight(tmp_path, RIGHT)
    for name in PLACES:
        (tmp_path / f"{name}.avi").write_bytes(b"no video")
    assert look_doubts(found) == []
