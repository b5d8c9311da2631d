"""A camera file held against the video it is used for, and against tracks made elsewhere."""

import json

import cv2
import numpy as np
import pytest

from calibration.foundation.errors import UsageError
from pipeline.flight import read_flight
from pipeline.stages.inputs.cameras import camera_notes, read_models

CAMERA = {"image_size": [64, 48], "K": [[80, 0, 31.5], [0, 80, 23.5], [0, 0, 1]], "distortion": [0, 0, 0, 0, 0]}


@pytest.fixture
def flight(tmp_path):
    """A flight file's reader: writes a camera file and lines of the camera's table, a video of 64 x 48 beside them."""
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (64, 48))
    for i in range(3):
        writer.write(np.full((48, 64, 3), 40 * i, np.uint8))
    writer.release()

    def made(change, *lines):
        (tmp_path / "c.json").write_text(json.dumps({**CAMERA, **change}))
        table = ['[cameras.a]\ncalibration = "c.json"\nvideo = "v.avi"', *lines]
        (tmp_path / "flight.toml").write_text("\n".join(table) + "\n")
        return read_flight(tmp_path / "flight.toml")

    return made


def test_a_camera_of_the_videos_pictures_is_taken_as_it_is(flight):
    assert read_models(flight({}))["a"].K[0, 0] == 80


@pytest.mark.parametrize("scale", [2, 0.75])
def test_another_size_is_refused_with_both(flight, scale):
    size = [round(64 * scale), round(48 * scale)]
    K = (np.diag([scale, scale, 1]) @ np.array(CAMERA["K"])).tolist()
    with pytest.raises(UsageError) as caught:
        read_models(flight({"image_size": size, "K": K}))
    said = str(caught.value)
    assert f"c.json is of {size[0]}x{size[1]} pictures, v.avi of 64x48" in said
    assert caught.value.where.endswith("flight.toml: cameras.a.calibration")
    assert f"video_area = {{ crop = [0, 0, {size[0]}, {size[1]}], of = [{size[0]}, {size[1]}] }}" in said
    area = f"video_area = {{ crop = [0, 0, {size[0]}, {size[1]}], of = [{size[0]}, {size[1]}] }}"
    np.testing.assert_allclose(read_models(flight({"image_size": size, "K": K}, area))["a"].K[0, 0], 80)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("video_area = { crop = [0, 0, 64, 48] }", "cameras.a.video_area.of"),
        ("video_area = { of = [64, 48] }", "cameras.a.video_area.crop"),
        ("video_area = { crop = [0, 0, 64, 48], of = [64.5, 48] }", "whole numbers"),
        ("video_area = { crop = [0, 0, 64, 48], off = [64, 48], of = [64, 48] }", "did you mean"),
    ],
)
def test_an_area_that_says_too_little_is_refused(flight, line, words):
    with pytest.raises(UsageError, match=words):
        flight({}, line)


def test_doubts_about_a_camera_name_it(flight):
    model = read_models(flight({"K": [[100, 0, 31.5], [0, 80, 23.5], [0, 0, 1]]}))["a"]
    assert camera_notes("a", model) == ("a: fx / fy is 1.250: were the pictures stretched to another shape?",)
