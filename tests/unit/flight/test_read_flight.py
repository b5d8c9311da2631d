"""The flight file: what is read, and one clear message for every mistake."""

import math
from pathlib import Path

import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.flight import read_flight
from pipeline.records import Box

WHOLE = """
[flight]
origin = { lat = 28.2, lon = 112.9, height = 60.0 }
reference_camera = "uav2"

[cameras.uav1]
calibration = "uav1.json"
video = "uav1.mp4"
tracker = "csrt"
telemetry = "uav1.tlog"
start = 12.34
frame_rate = 25.0
offset_s = "search"
clock = "affine"
mount = { roll_deg = 0, pitch_deg = -30, yaw_deg = 10 }
lever_arm_m = [0.1, 0.0, 0.05]
[cameras.uav1.sigma]
attitude_bias_deg = 0.5
pixel = 0.3
offset_s = 2.0

[cameras.uav2]
calibration = "uav2.json"
tracks = "uav2-tracks.csv"
pose = { east_m = 1, north_m = 2, up_m = 3, yaw_deg = 90, pitch_deg = 0, roll_deg = 0 }
start = 2025-06-01T09:30:00Z
offset_s = 1.5

[targets.car1]
motion = "polynomial"
order = 1
boxes.uav1 = { frame = 3, box = [612, 340, 24, 18] }

[solve]
method = "algorithm-2"
frame_rate = "fixed"
robust = "none"
"""

CAMERA = '[cameras.uav1]\ncalibration = "uav1.json"\n'


def flight(tmp_path: Path, text: str):
    path = tmp_path / "flight.toml"
    path.write_text(text)
    return read_flight(path)


def test_every_key_arrives_in_si_units(tmp_path):
    found = flight(tmp_path, WHOLE)
    one, two = found.cameras
    assert found.reference_camera == "uav2"
    assert found.origin.lat_rad == pytest.approx(math.radians(28.2))
    assert (one.video, one.telemetry) == (tmp_path / "uav1.mp4", tmp_path / "uav1.tlog")
    assert (one.tracker, two.tracker) == ("csrt", "kcf")
    assert one.start == 12.34
    assert one.offset_s is None
    assert one.mount.pitch_rad == pytest.approx(math.radians(-30))
    assert one.lever_arm_m == (0.1, 0.0, 0.05)
    assert one.sigma == {"attitude_bias_rad": math.radians(0.5), "pixel_px": 0.3, "offset_s": 2.0}
    assert two.pose.position_enu_m == (1, 2, 3)
    assert two.start == "2025-06-01T09:30:00+00:00"
    assert two.offset_s == 1.5
    assert found.targets[0].boxes == {"uav1": Box(frame=3, x=612, y=340, width=24, height=18)}
    assert (found.solve.method, found.solve.frame_rate, found.solve.robust) == ("algorithm-2", "fixed", "none")


def test_several_boxes_come_in_order_of_their_frames(tmp_path):
    two = "[{ frame = 9, box = [5, 6, 7, 8] }, { frame = 3, box = [1, 2, 3, 4] }]"
    target = flight(tmp_path, CAMERA + f"[targets.a]\nboxes.uav1 = {two}\n").targets[0]
    assert [box.frame for box in target.labels["uav1"]] == [3, 9]
    assert target.boxes["uav1"] == Box(frame=3, x=1, y=2, width=3, height=4)


def test_defaults(tmp_path):
    found = flight(tmp_path, CAMERA)
    camera = found.cameras[0]
    assert (found.origin, found.reference_camera, found.targets) == (None, "uav1", ())
    assert (camera.video, camera.offset_s, camera.clock, dict(camera.sigma)) == (None, None, "auto", {})
    assert (found.solve.method, found.solve.robust, found.solve.rate_hz) == ("map", "huber", 10.0)


def test_box_centre_is_in_pixel_centre_coordinates():
    assert Box(frame=0, x=10, y=20, width=3, height=4).centre_px == (11.0, 21.5)


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("[cameras.uav1\n", "flight.toml", "TOML"),
        ("", "cameras", "at least one"),
        ("[camera.uav1]\n" + CAMERA, "camera", "did you mean 'cameras'?"),
        (CAMERA + "frame_rat = 25\n", "cameras.uav1.frame_rat", "did you mean 'frame_rate'?"),
        ("[cameras.uav1]\n", "cameras.uav1.calibration", "runningfix calibrate"),
        (CAMERA + "frame_rate = 0\n", "cameras.uav1.frame_rate", "from 0.01"),
        (CAMERA + 'frame_rate = "25"\n', "cameras.uav1.frame_rate", "without quotes"),
        (CAMERA + "frame_rate = nan\n", "cameras.uav1.frame_rate", "from 0.01"),
        (CAMERA + "frame_rate = true\n", "cameras.uav1.frame_rate", "from 0.01"),
        (CAMERA + 'offset_s = "soon"\n', "cameras.uav1.offset_s", "finite number"),
        (CAMERA + 'start = "yesterday"\n', "cameras.uav1.start", "ISO-8601"),
        (CAMERA + 'mount = "gimball"\n', "cameras.uav1.mount", "gimbal"),
        (CAMERA + "mount = { pitch = 3 }\n", "cameras.uav1.mount.pitch", "pitch_deg"),
        (CAMERA + "lever_arm_m = [1, 2]\n", "cameras.uav1.lever_arm_m", "3 numbers"),
        (CAMERA + "pose = { east_m = 1 }\n", "cameras.uav1.pose.north_m", "yaw_deg"),
        (CAMERA + 'tracker = "CSRT"\n', "cameras.uav1.tracker", "kcf"),
        (CAMERA + "tracker = 2\n", "cameras.uav1.tracker", "csrt"),
        (CAMERA + 'clock = "cheap"\n', "cameras.uav1.clock", "affine"),
        (CAMERA + "video = 3\n", "cameras.uav1.video", "quotes"),
        (CAMERA + "[cameras.uav1.sigma]\npixel = 0\n", "cameras.uav1.sigma.pixel", "above 0"),
        (CAMERA + "[cameras.uav1.sigma]\nattitude_deg = -1\n", "cameras.uav1.sigma.attitude_deg", "from 0"),
        (CAMERA + "[cameras.uav1.sigma]\nposition = 1\n", "cameras.uav1.sigma.position", "position_m"),
        (CAMERA + "[targets.a]\norder = 6\n", "targets.a.order", "auto"),
        (CAMERA + "[targets.a]\nboxes.uav1 = { frame = -1, box = [1, 2, 3, 4] }\n", "boxes.uav1.frame", "count from 0"),
        (CAMERA + "[targets.a]\nboxes.uav1 = { frame = 0, box = [1, 2, 3] }\n", "boxes.uav1.box", "4 numbers"),
        (CAMERA + "[targets.a]\nboxes.uav1 = { box = [1, 2, 1, 1] }\n", "boxes.uav1.box", "at least 2 px"),
        (CAMERA + "[targets.a]\nboxes.uav2 = { box = [1, 2, 9, 9] }\n", "targets.a.boxes.uav2", "did you mean 'uav1'?"),
        (CAMERA + "[targets.a]\nboxes.uav1 = []\n", "targets.a.boxes.uav1", "several on different frames"),
        (CAMERA + "[targets.a]\nboxes.uav1 = [{ box = [1, 2, 9, 9] }, 3]\n", "boxes.uav1[1]", "a table"),
        (
            CAMERA + "[targets.a]\nboxes.uav1 = [{ box = [1, 2, 9, 9] }, { box = [1, 2, 9, 9] }]\n",
            "targets.a.boxes.uav1",
            "several on different frames",
        ),
        (CAMERA + '[solve]\nmethod = "mapp"\n', "solve.method", "did you mean 'map'?"),
        (CAMERA + '[flight]\nreference_camera = "uav9"\n', "flight.reference_camera", "did you mean 'uav1'?"),
        (CAMERA + "[flight]\norigin = { lat = 98, lon = 1 }\n", "flight.origin.lat", "from -90 to 90"),
        (CAMERA + "[flight]\norigin = { lat = 9 }\n", "flight.origin.lon", "degrees"),
        ("cameras = 3\n", "cameras", "a table"),
    ],
)
def test_a_mistake_names_its_place_and_its_remedy(tmp_path, text, where, words):
    with pytest.raises(UsageError) as caught:
        flight(tmp_path, text)
    assert caught.value.exit_code == 2
    assert where in caught.value.where
    assert words in str(caught.value)
    assert str(tmp_path / "flight.toml") in caught.value.where


def test_the_log_may_be_in_the_video(tmp_path):
    (tmp_path / "flight.toml").write_text(
        '[cameras.a]\ncalibration = "a.json"\nvideo = "clip.ts"\ntelemetry = "video"\n'
    )
    camera = read_flight(tmp_path / "flight.toml").camera("a")
    assert camera.telemetry == camera.video == tmp_path / "clip.ts"


def test_the_log_cannot_be_in_no_video(tmp_path):
    (tmp_path / "flight.toml").write_text('[cameras.a]\ncalibration = "a.json"\ntelemetry = "video"\n')
    with pytest.raises(UsageError, match="a camera with a video"):
        read_flight(tmp_path / "flight.toml")


def test_pose_and_telemetry_together_are_refused(tmp_path):
    pose = "pose = { east_m = 1, north_m = 2, up_m = 3 }\n"
    with pytest.raises(UsageError, match="not both"):
        flight(tmp_path, CAMERA + pose + 'telemetry = "a.tlog"\n')


def test_a_missing_flight_file_is_an_input_error(tmp_path):
    with pytest.raises(InputFileError, match="no such file") as caught:
        read_flight(tmp_path / "nowhere.toml")
    assert caught.value.exit_code == 3
