"""What a video says of its camera: packed by hand as Apple, DJI and Android write it; and that it is held against."""

import struct
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.camera_files import doubts
from calibration.photos.video_metadata import said_by_video
from calibration.picture import Picture, fitted
from pipeline.synthetic.board_views import camera


def box(kind, *content):
    inside = b"".join(content)
    return struct.pack(">I4s", 8 + len(inside), kind) + inside


def keyed(full, **values):
    """A meta box of keys and values; `full`: with a version, as ISO has it."""
    names = b"".join(box(b"mdta", name.replace("_", ".").encode()) for name in values)
    items = b"".join(
        box(struct.pack(">I", i + 1), box(b"data", struct.pack(">II", 1, 0), text.encode()))
        for i, text in enumerate(values.values())
    )
    head = b"\0" * 4 if full else b""
    keys = box(b"keys", struct.pack(">II", 0, len(values)), names)
    return box(b"meta", head, box(b"hdlr", b"\0" * 24), keys, box(b"ilst", items))


def text(kind, words):
    return box(kind, struct.pack(">HH", len(words), 0x55C4), words.encode())


APPLE = {"com_apple_quicktime_make": "Apple", "com_apple_quicktime_model": "iPhone 12"}


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (keyed(False, **APPLE), {"maker": "Apple", "camera": "iPhone 12"}),
        (box(b"udta", keyed(True, **APPLE)), {"maker": "Apple", "camera": "iPhone 12"}),
        (box(b"udta", text(b"\xa9mdl", "FC6310"), text(b"\xa9xyz", "+28+112/")), {"camera": "FC6310"}),
        (keyed(True, com_android_model="Pixel 8"), {"camera": "Pixel 8"}),
        (b"", {}),
        (box(b"udta", b"\0\0\0\1cut"), {}),
    ],
)
def test_what_took_it(tmp_path, inside, said):
    path = tmp_path / "v.mp4"
    moov = box(b"moov", box(b"mvhd", b"\0" * 100), box(b"trak", b"\xa9mod" * 50), inside)
    path.write_bytes(box(b"ftyp", b"isom") + box(b"mdat", b"\0" * 999) + moov)
    assert said_by_video(path) == said


def test_what_is_no_mp4_says_nothing(tmp_path):
    (tmp_path / "v.mp4").write_bytes(bytes(range(256)) * 4)
    assert said_by_video(tmp_path / "v.mp4") == {}
    assert said_by_video(tmp_path / "none.mp4") == {}


@pytest.mark.parametrize(("theirs", "told"), [("FC220", True), ("FC6310", False), ("fc6310 v2", False), ("", False)])
def test_a_video_of_another_camera_is_told(theirs, told):
    lens = replace(camera(), made={"camera": "FC6310"})
    picture = Picture(size=lens.image_size, said={"camera": theirs})
    made = fitted(lens, picture, file=Path("c.json"), video=Path("v.mp4"), where="calibration")
    assert any("'FC6310'" in words and "'FC220'" in words for words in doubts(made)) == told
