"""No name of a video becomes a protocol, and no text a list of other files."""

import os

import pytest

from calibration.foundation.errors import InputFileError
from calibration.foundation.videos import open_video
from pipeline.tracking import video_head, video_times
from tests.scenes.containers import muxed, numbered


@pytest.mark.parametrize(
    "name",
    [b"http:x.mp4", b"http:/127.0.0.1:9/x.mp4", b"concat:a.mp4|b.mp4", b"pipe:0", b"data:video;base64,AAAA", b"-i.mp4",
     b"a%03d.mp4", b"caf\xe9.mp4", b"subfile,,start,0,end,0,,:x.mp4"],
)  # fmt: skip
def test_a_name_is_only_a_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = type(tmp_path)(os.fsdecode(name))
    path.parent.mkdir(parents=True, exist_ok=True)
    muxed(tmp_path / "plain.mp4", numbered(3)).rename(path)
    assert video_times(path).frames == 3


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
    for read in (open_video, video_head):
        with pytest.raises(InputFileError, match="playlist"):
            read(path)


def test_raw_video_begins_as_text(tmp_path):
    path = tmp_path / "raw.y4m"
    path.write_bytes(b"YUV4MPEG2 W64 H64 F25:1\nFRAME\n" + b" " * 600)
    with open_video(path) as file:
        assert file.read(9) == b"YUV4MPEG2"


def test_pipes_devices_folders_and_missing_files_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    for path, words in (
        (tmp_path / "pipe.mp4", "a pipe"), (tmp_path, "a folder"), (type(tmp_path)("/dev/zero"), "a device"),
        (tmp_path / "none.mp4", "no such file"),
    ):  # fmt: skip
        with pytest.raises(InputFileError, match=words):
            video_head(path)
