"""What a JPEG says about the camera that took it: model, serial number, focal length, as far as EXIF has them.

TIFF inside an APP1 segment: byte order, then directories of 12-byte entries (tag, type, count, value or offset).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

TAGS = {
    0x010F: "maker",
    0x0110: "camera",
    0x0112: "orientation",
    0x920A: "focal_mm",
    0xA431: "serial",
}
SUBDIRECTORY = 0x8769
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 7: 1, 9: 4, 10: 8}


def exif_of(raw: bytes) -> Mapping[str, str]:
    """The tags of `TAGS` found in the bytes of a JPEG, as texts; empty where there are none or they are broken."""
    try:
        tiff = _tiff(raw)
        return {} if tiff is None else _directory(tiff, "<" if tiff[:2] == b"II" else ">", None, 0)
    except (struct.error, IndexError, ValueError):
        return {}


def _tiff(raw: bytes) -> bytes | None:
    if raw[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 4 <= len(raw) and raw[at] == 0xFF and raw[at + 1] not in (0xDA, 0xD9):
        length = struct.unpack(">H", raw[at + 2 : at + 4])[0]
        if raw[at + 1] == 0xE1 and raw[at + 4 : at + 10] == b"Exif\0\0":
            return raw[at + 10 : at + 2 + length]
        at += 2 + length
    return None


def _directory(tiff: bytes, order: str, start: int | None, depth: int) -> dict[str, str]:
    at = struct.unpack(order + "I", tiff[4:8])[0] if start is None else start
    found: dict[str, str] = {}
    for i in range(min(struct.unpack(order + "H", tiff[at : at + 2])[0], 512)):
        entry = tiff[at + 2 + 12 * i : at + 14 + 12 * i]
        tag, kind, count = struct.unpack(order + "HHI", entry[:8])
        if tag == SUBDIRECTORY and depth == 0:
            found |= _directory(tiff, order, struct.unpack(order + "I", entry[8:])[0], 1)
        elif tag in TAGS:
            size = SIZES.get(kind, 1) * count
            place = entry[8:] if size <= 4 else tiff[struct.unpack(order + "I", entry[8:])[0] :][:size]
            found[TAGS[tag]] = _text(place, kind, order)
    return {name: text for name, text in found.items() if text}


def _text(raw: bytes, kind: int, order: str) -> str:
    if kind == 2:
        return raw.split(b"\0")[0].decode("ascii", "replace").strip()
    if kind in (5, 10):
        top, bottom = struct.unpack(order + ("II" if kind == 5 else "ii"), raw[:8])
        return f"{top / bottom:g}" if bottom else ""
    return str(struct.unpack(order + ("H" if kind == 3 else "I"), raw[: 2 if kind == 3 else 4])[0])
