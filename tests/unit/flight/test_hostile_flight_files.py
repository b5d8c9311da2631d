"""Flight files that cannot be: each is refused in words, soon, with its place; none ends in another exception."""

import os

import pytest

from calibration.foundation.errors import InputFileError, RunningFixError, UsageError
from pipeline.flight import read_flight
from pipeline.flight.read import LARGEST_BYTES

CAMERA = '[cameras.uav1]\ncalibration = "uav1.json"\n'
DIGITS = "9" * 5000
LONG = "k" * 900_000


def refused(tmp_path, content: str | bytes) -> RunningFixError:
    path = tmp_path / "flight.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RunningFixError) as caught:
        read_flight(path)
    assert len(str(caught.value)) < 3000, "a message, not the file"
    return caught.value


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        (CAMERA + "frame_rate = 1e-300\n", "cameras.uav1.frame_rate", "from 0.01"),
        (CAMERA + "frame_rate = 1e300\n", "cameras.uav1.frame_rate", "to 100000"),
        (CAMERA + f"offset_s = {'9' * 400}\n", "cameras.uav1.offset_s", "about 401 digits"),
        (CAMERA + f"offset_s = {DIGITS}\n", "flight.toml", "not valid TOML"),
        (CAMERA + "video = " + "[" * 50_000 + "]" * 50_000, "flight.toml", "nested too deeply"),
        (CAMERA + f"{LONG} = 1\n", "cameras.uav1.kkk", "an unknown key"),
        (CAMERA + f'title = "{LONG}"\n', "cameras.uav1.title", "unknown"),
        (CAMERA + f'video = "{LONG}"\n', "cameras.uav1.video", "characters"),
        (CAMERA + 'video = "a\\u0000b"\n', "cameras.uav1.video", "control"),
        (f"[cameras.{LONG}]\n", "cameras.kkk", "a name of 1 to 100"),
        ('[cameras." "]\n', "cameras. ", "an empty name"),
        (CAMERA + CAMERA, "flight.toml", "not valid TOML"),
        (CAMERA + 'calibration = "b.json"\n', "flight.toml", "not valid TOML"),
        (
            CAMERA + "[targets.a]\nboxes.uav1 = { frame = 10000000000000000000, box = [1, 2, 9, 9] }\n",
            "frame",
            "to 2147",
        ),
        (b"\xff\xfe[\x00c\x00", "flight.toml", "not valid TOML"),
        (CAMERA.encode() + b'video = "\xe9.mp4"\n', "flight.toml", "utf-8"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(tmp_path, text, where, words):
    error = refused(tmp_path, text)
    assert isinstance(error, UsageError)
    assert where in error.where
    assert words in str(error)


def test_a_byte_order_mark_is_skipped(tmp_path):
    path = tmp_path / "flight.toml"
    path.write_bytes(b"\xef\xbb\xbf" + CAMERA.encode())
    assert read_flight(path).cameras[0].name == "uav1"


def test_a_pipe_a_device_and_a_folder_are_no_flight_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, words in ((tmp_path / "pipe", "a pipe"), (tmp_path, "a folder")):
        with pytest.raises(InputFileError, match=words):
            read_flight(path)
    with pytest.raises(InputFileError, match="a device"):
        read_flight(type(tmp_path)("/dev/zero"))


def test_a_flight_file_without_end_is_refused_at_its_bound(tmp_path):
    error = refused(tmp_path, b"#" * (LARGEST_BYTES + 1))
    assert isinstance(error, InputFileError)
    assert f"{LARGEST_BYTES:,}" in error.seen


@pytest.mark.parametrize(
    "dotted", ["a" + ".a" * 400_000 + " = 1", "[x" + ".'a'" * 200_000 + "]", "b = { a" + ".a" * 400_000 + " = 1 }"]
)
def test_keys_that_would_take_time_with_their_square_are_refused_unread(tmp_path, dotted):
    assert "parts on line 3" in refused(tmp_path, CAMERA + dotted).seen


def test_dots_in_comments_and_lists_are_no_keys(tmp_path):
    path = tmp_path / "flight.toml"
    path.write_text(f"# {'.' * 200}\n{CAMERA}lever_arm_m = [0.1, 0.2, 0.3]  # {'.' * 200}\n")
    assert read_flight(path).cameras[0].lever_arm_m == (0.1, 0.2, 0.3)
