"""What a photo says about the camera that took it: model, serial number, focal length, as far as it says so (EXIF)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from io import BytesIO
from typing import Any

from PIL import ExifTags, Image

RESIZED_KEY = "resized_from"
"""Under which a photo of another size than its camera wrote says that size."""

TAGS = {
    ExifTags.Base.Make: "maker",
    ExifTags.Base.Model: "camera",
    ExifTags.Base.Orientation: "orientation",
    ExifTags.Base.FocalLength: "focal_mm",
    ExifTags.Base.BodySerialNumber: "serial",
    ExifTags.Base.ExifImageWidth: "wrote_width",
    ExifTags.Base.ExifImageHeight: "wrote_height",
}


def metadata_of(raw: bytes) -> Mapping[str, str]:
    """The tags of `TAGS` in the bytes of a photo (JPEG, PNG, TIFF, WebP ...), as texts; empty where it has none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged or very large metadata: what can be read is taken
            with Image.open(BytesIO(raw)) as picture:
                exif = picture.getexif()
                entries = {**exif, **exif.get_ifd(ExifTags.IFD.Exif)}
    except (OSError, ValueError, SyntaxError, TypeError, KeyError, Image.DecompressionBombError):
        return {}
    said = {name: _text(entries[tag]) for tag, name in TAGS.items() if tag in entries}
    return {name: text for name, text in said.items() if text}


def _text(value: Any) -> str:
    """A tag's value as a text; a fraction of nothing says nothing."""
    if isinstance(value, bytes):
        value = value.decode("ascii", "replace")
    if isinstance(value, str):
        return value.split("\0")[0].strip()
    if isinstance(value, tuple):
        return _text(value[0]) if value else ""
    number = float(value)
    return f"{number:g}" if number == number else ""
