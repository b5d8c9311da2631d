"""What a video says about the camera that took it: maker and model, where an MP4 or MOV has them (user data, keys)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

MOST_BYTES = 4_000_000
"""Of user data that are read: they hold a few names; larger ones are thumbnails, and telemetry of other rooms."""

USER_DATA = {b"\xa9mak": "maker", b"\xa9mod": "camera", b"\xa9mdl": "camera"}
KEYS = {"com.apple.quicktime.make": "maker", "com.apple.quicktime.model": "camera", "com.android.manufacturer": "maker",
        "com.android.model": "camera"}  # fmt: skip
"""Names of user data (QuickTime, DJI) and of keyed metadata (Apple, Android), and what they are here."""


def said_by_video(path: Path) -> Mapping[str, str]:
    """Maker and model ("maker", "camera") as texts; empty where the file tells none, or is no MP4 or MOV."""
    said: dict[str, str] = {}
    try:
        with path.open("rb") as file:
            moov = _moov(file)
            for kind, content in _boxes(moov):
                if kind == b"udta":
                    said |= _user_data(content)
                if kind == b"meta":
                    said |= _keyed(content)
    except (OSError, struct.error, ValueError):
        return {}
    return said


def _moov(file: BinaryIO) -> bytes:
    """The moov box without its tracks' tables, b"" where there is none."""
    for _ in range(64):
        head = file.read(8)
        if len(head) < 8:
            return b""
        size, kind = struct.unpack(">I4s", head)
        extra = 8
        if size == 1:
            size, extra = struct.unpack(">Q", file.read(8))[0], 16
        if kind == b"moov":
            return bytes(_without_tracks(file, file.tell() + size - extra))
        if size < extra:
            return b""
        file.seek(size - extra, 1)
    return b""


def _without_tracks(file: BinaryIO, end: int) -> bytearray:
    """The boxes before `end`, of those that are not tracks and not too large."""
    kept = bytearray()
    while file.tell() + 8 <= end:
        head = file.read(8)
        if len(head) < 8:
            break
        size, kind = struct.unpack(">I4s", head)
        if size < 8 or file.tell() + size - 8 > end:
            break
        if kind in (b"udta", b"meta") and size <= MOST_BYTES:
            kept += head + file.read(size - 8)
        else:
            file.seek(size - 8, 1)
    return kept


def _boxes(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 8 <= len(content):
        size, kind = struct.unpack_from(">I4s", content, at)
        if size < 8 or at + size > len(content):
            return
        yield kind, content[at + 8 : at + size]
        at += size


def _user_data(content: bytes) -> dict[str, str]:
    """QuickTime's texts: their length and language, then the text; or, in a meta box, an iTunes list."""
    said = {}
    for kind, value in _boxes(content):
        if kind in USER_DATA and len(value) > 4:
            length = struct.unpack_from(">H", value)[0]
            said[USER_DATA[kind]] = _text(value[4 : 4 + length])
        if kind == b"meta":
            said |= _keyed(value) or _keyed(value[4:])
    return {name: text for name, text in said.items() if text}


def _keyed(content: bytes) -> dict[str, str]:
    """Keys and the list of their values; of an ISO meta box, the four bytes of its version are skipped."""
    parts = dict(_boxes(content)) or dict(_boxes(content[4:]))
    names, said = [], {}
    if b"keys" in parts:
        at, keys = 8, parts[b"keys"]
        while at + 8 <= len(keys):
            size = struct.unpack_from(">I", keys, at)[0]
            if size < 8:
                break
            names.append(keys[at + 8 : at + size].decode("utf-8", "replace"))
            at += size
    for kind, item in _boxes(parts.get(b"ilst", b"")):
        number = struct.unpack(">I", kind)[0]
        name = KEYS.get(names[number - 1]) if 1 <= number <= len(names) else USER_DATA.get(kind)
        data = dict(_boxes(item)).get(b"data", b"")
        if name is not None and len(data) > 8:
            said[name] = _text(data[8:])
    return {name: text for name, text in said.items() if text}


def _text(raw: bytes) -> str:
    return raw.split(b"\0")[0].decode("utf-8", "replace").strip()
