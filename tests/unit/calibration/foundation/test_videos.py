"""No name of a video becomes a protocol, and no text a list of other files."""

import os

import pytest

from calibration.foundation.errors import InputFileError
from calibration.foundation.videos import video_name
from pipeline.tracking import video_head

MP4 = b"\0\0\0\x18ftypmp42" + bytes(600)


@pytest.mark.parametrize(
    "name", ["http:x.mp4", "concat:a.mp4|b.mp4", "pipe:0", "data:video;base64,AAAA", "-i.mp4", "a%03d.mp4"]
)
def test_a_name_is_absolute_for_libraries(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = type(tmp_path)(name)
    path.write_bytes(MP4)
    assert video_name(path) == str(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        "#EXTM3U\n#EXTINF:10,\nfile:///etc/passwd\n", "ffconcat version 1.0\nfile a\n", "v=0\no=- 0 0 IN IP4\n",
        '<?xml version="1.0"?><MPD/>', "[playlist]\nFile1=http://x/\n", "\ufeff#EXTM3U\n", "this is no video",
    ],
)  # fmt: skip
def test_text_that_names_other_files_is_refused(tmp_path, text):
    path = tmp_path / "list.mp4"
    path.write_text(text)
    for read in (video_name, video_head):
        with pytest.raises(InputFileError, match="playlist"):
            read(path)


def test_raw_video_begins_as_text(tmp_path):
    path = tmp_path / "raw.y4m"
    path.write_bytes(b"YUV4MPEG2 W64 H64 F25:1\nFRAME\n" + b" " * 600)
    assert video_name(path) == str(path)


def test_pipes_devices_folders_and_names_that_are_no_text_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    strange = type(tmp_path)(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.mp4"))
    strange.write_bytes(MP4)
    for path, words in (
        (tmp_path / "pipe.mp4", "a pipe"), (tmp_path, "a folder"), (type(tmp_path)("/dev/zero"), "a device"),
        (tmp_path / "none.mp4", "no such file"), (strange, "not UTF-8"),
    ):  # fmt: skip
        with pytest.raises(InputFileError, match=words):
            video_head(path)
