"""Pictures of a list are frames of a flight's cameras, by their names."""

from pathlib import Path

import pytest

from calibration.foundation.errors import InputFileError
from pipeline.flight import flight_of
from pipeline.stages.drafting.landmarks import frame_of

TEXT = """
[cameras.left]
calibration = "c.json"
video = "DJI_0012.MP4"
[cameras.left2]
calibration = "c.json"
video = "DJI_0012_b.MP4"
[cameras.tripod]
calibration = "c.json"
tracks = "t.csv"
pose = { east_m = 0, north_m = 0, up_m = 2, yaw_deg = 0, pitch_deg = 0, roll_deg = 0 }
"""
CAMERAS = flight_of(TEXT.encode(), Path("flight.toml")).cameras


@pytest.mark.parametrize(
    ("picture", "expected"),
    [
        ("DJI_0012_000120.png", ("left", 120)),
        ("frames/dji_0012.MP4_frame120.JPG", ("left", 120)),
        ("C:\\frames\\left-7.png", ("left", 7)),
        ("left2_7.tif", ("left2", 7)),
        ("DJI_0012_b_7.png", ("left2", 7)),
        ("tripod.jpg", ("tripod", 0)),
        ("left27.png", None),
        ("DJI_00121.png", None),
        ("other_12.png", None),
    ],
)
def test_camera_and_frame_of_a_picture(picture, expected):
    assert frame_of(picture, CAMERAS, 0, "line 2") == expected


def test_pictures_that_count_from_one():
    assert frame_of("left_1.png", CAMERAS, 1, "line 2") == ("left", 0)
    with pytest.raises(InputFileError) as caught:
        frame_of("left_0.png", CAMERAS, 1, "line 2")
    assert "first-frame" in caught.value.advice


def test_a_moving_camera_needs_a_frame_number():
    with pytest.raises(InputFileError) as caught:
        frame_of("DJI_0012.MP4", CAMERAS, 0, "line 2")
    assert "DJI_0012.MP4_000120.png" in caught.value.expected
