"""Any picture: more than 8 bits, alpha, other formats; and what cannot be read is told."""

import cv2
import numpy as np
import pytest
from PIL import Image

from calibration.foundation.errors import InputFileError
from calibration.photos.metadata import metadata_of
from calibration.photos.reading import find_photos, read_photo, to_eight_bits

GRAY = np.tile(np.linspace(30, 220, 64).astype(np.uint8), (48, 1))


def test_thermal_counts_are_stretched_over_what_they_hold(tmp_path):
    counts = (7000 + GRAY.astype(np.uint16) * 3).astype(np.uint16)
    counts[0, 0], counts[0, 1] = 0, 65535  # a dead and a hot pixel
    cv2.imwrite(str(tmp_path / "t.png"), counts)
    cv2.imwrite(str(tmp_path / "t.tiff"), counts)
    for name in ("t.png", "t.tiff"):
        gray = read_photo(tmp_path / name).gray
        assert gray.dtype == np.uint8
        assert gray[5, 0] < 5
        assert gray[5, -1] > 250
        assert np.all(np.diff(gray[5].astype(int)) >= 0)


def test_floats_with_holes_and_pictures_of_one_tone():
    values = GRAY.astype(np.float32) / 7
    values[3, 3] = np.nan
    assert to_eight_bits(values)[:, -1].min() > 250
    assert to_eight_bits(np.full((4, 4), 9, np.uint16)).max() == 0
    assert to_eight_bits(np.full((4, 4), np.nan, np.float32)).max() == 0
    assert to_eight_bits(GRAY) is GRAY


@pytest.mark.parametrize("name", ["p.png", "p.webp", "p.tif", "p.bmp", "p.jpg", "p.pgm"])
def test_every_format_gives_the_same_tones(tmp_path, name):
    cv2.imwrite(str(tmp_path / name), GRAY, [cv2.IMWRITE_WEBP_QUALITY, 101] if name.endswith("webp") else [])
    assert np.abs(read_photo(tmp_path / name).gray.astype(int) - GRAY).max() <= 3


def test_alpha_hides_nothing(tmp_path):
    rgba = np.dstack([GRAY, GRAY, GRAY, np.full_like(GRAY, 10)])
    cv2.imwrite(str(tmp_path / "a.png"), rgba)
    assert np.abs(read_photo(tmp_path / "a.png").gray.astype(int) - GRAY).max() <= 1


def test_what_is_drawn_in_the_alpha_channel_only_is_seen_over_white(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([0 * GRAY, 0 * GRAY, 0 * GRAY, 255 - GRAY]))
    assert np.abs(read_photo(tmp_path / "a.png").gray.astype(int) - GRAY).max() <= 1


def test_colours_as_floats_are_read(tmp_path):
    values = np.dstack([GRAY / 50, GRAY / 50, GRAY / 50]).astype(np.float32)
    cv2.imwrite(str(tmp_path / "f.tiff"), values)
    gray = read_photo(tmp_path / "f.tiff").gray.astype(int)
    assert gray[0, 0] < 5
    assert gray[0, -1] > 250


def test_a_photo_of_another_size_than_its_camera_wrote_says_so(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA002: 4000, 0xA003: 3000})
    Image.fromarray(GRAY).save(tmp_path / "small.jpg", exif=exif)
    assert read_photo(tmp_path / "small.jpg").taken["resized_from"] == "4000x3000"
    exif.get_ifd(0x8769).update({0xA002: 48, 0xA003: 64})  # of the picture as it is shown, turned
    Image.fromarray(GRAY).save(tmp_path / "whole.jpg", exif=exif)
    assert "resized_from" not in read_photo(tmp_path / "whole.jpg").taken


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_every_format_says_what_took_it(tmp_path, kind):
    picture, exif = Image.fromarray(GRAY), Image.Exif()
    exif[0x0110], exif[0x0112] = "FC300X", 6
    exif.get_ifd(0x8769)[0xA431] = "0012345"
    exif.get_ifd(0x8769)[0x920A] = 3.61
    picture.save(tmp_path / "p", kind, exif=exif)
    said = metadata_of((tmp_path / "p").read_bytes())
    assert (said["camera"], said["orientation"]) == ("FC300X", "6")
    if kind != "TIFF":  # Pillow writes no EXIF directory into one
        assert (said["serial"], said["focal_mm"]) == ("0012345", "3.61")


def test_what_cannot_be_read_is_told(tmp_path):
    heic = b"\0\0\0\x18ftypheic" + bytes(40)
    (tmp_path / "a.HEIC").write_bytes(heic)
    with pytest.raises(InputFileError, match=r"only photos that cannot be read here \(\.HEIC\).*export them as JPEG"):
        find_photos([tmp_path])
    (tmp_path / "b.jpg").write_bytes(heic)
    with pytest.raises(InputFileError, match="HEIF family \\(heic\\)"):
        read_photo(tmp_path / "b.jpg")
    (tmp_path / "b.dng").write_bytes(b"raw beside its JPEG")
    found = find_photos([tmp_path])
    assert [f.name for f in found.photos] == ["b.jpg"]
    assert [f.name for f in found.unread] == ["a.HEIC"]
