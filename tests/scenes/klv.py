"""ST 0601 metadata and transport streams that the tests write, packed by hand after the standards."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

KEY = bytes.fromhex("060E2B34020B01010E01030101000000")
VIDEO_PID, MAP_PID = 0x101, 0x100

STANDARDS_EXAMPLE = bytes.fromhex(
    "060E2B34020B01010E0103010100000081D2020800046050584E0180030A4D697373696F6E20"
    "3132050271C20602FD3D070208B80A085072656461746F720B07454F204E6F73650C0E47656F"
    "64657469632057475338340D045595B66D0E045B5360C40F02C2211002CD9C1102D917120472"
    "4A0A20130487F84B86140400000000150403830926160212811704F101A229180414BC082B19"
    "0234F3301C01010102010703052F2F5553410C01070D060055005300411602000A4101065E22"
    "0170F592F02373364AF8AA9162C00F2EB2DA16B74341000841A0BE365B5AB96A36450102AA43"
)
"""The dynamic and constant packet of MISB ST 0902.5, annex C."""

UNSIGNED = {5: (2, 0, 360), 15: (2, -900, 19000), 16: (2, 0, 180), 17: (2, 0, 180), 18: (4, 0, 360), 20: (4, 0, 360),
            75: (2, -900, 19000)}  # fmt: skip
SIGNED = {6: (2, 20), 7: (2, 50), 13: (4, 90), 14: (4, 180), 19: (4, 180), 90: (4, 90), 91: (4, 90)}
ERRORS = {6: b"\x80\0", 7: b"\x80\0", 13: b"\x80\0\0\0", 14: b"\x80\0\0\0", 19: b"\x80\0\0\0", 90: b"\x80\0\0\0",
          91: b"\x80\0\0\0"}  # fmt: skip


def value_of(item: int, value: float | str) -> bytes:
    """One item's value as the standard packs it."""
    if isinstance(value, str):
        return value.encode()
    if item == 2:
        return round(value * 1e6).to_bytes(8, "big")
    if item == 136:
        return round(value).to_bytes(2, "big", signed=True)
    if item == 104:
        scale = 2.0 ** (23 - math.ceil(math.log2(40900)))
        return int(scale * (value + 900) + (-900 * scale) % 1).to_bytes(3, "big")
    if item in UNSIGNED:
        size, low, high = UNSIGNED[item]
        return round((value - low) / (high - low) * (2 ** (8 * size) - 1)).to_bytes(size, "big")
    size, half = SIGNED[item]
    return round(value / half * (2 ** (8 * size - 1) - 1)).to_bytes(size, "big", signed=True)


def length_of(many: int) -> bytes:
    return bytes([many]) if many < 128 else b"\x82" + many.to_bytes(2, "big")


def local_set(values: Mapping[int, float | str | bytes], *, checked: bool = True) -> bytes:
    """A whole set: key, length, items, checksum; bytes are taken as they are."""
    body = b""
    for item, value in values.items():
        packed = value if isinstance(value, bytes) else value_of(item, value)
        number = bytes([item]) if item < 128 else bytes([0x80 | item >> 7, item & 0x7F])
        body += number + length_of(len(packed)) + packed
    if not checked:
        return KEY + length_of(len(body)) + body
    head = KEY + length_of(len(body) + 4) + body + b"\x01\x02"
    total = sum(byte << (8 * ((i + 1) % 2)) for i, byte in enumerate(head)) & 0xFFFF
    return head + total.to_bytes(2, "big")


def at_place(
    stamp_s: float,
    *,
    lat: float = 28.2,
    lon: float = 112.9,
    height_m: float = 100.0,
    heading: float = 90.0,
    **more: float,
) -> dict[int, float | str | bytes]:
    """The items of a level platform whose sensor looks 30 degrees down, ahead."""
    return {2: stamp_s, 5: heading, 90: 0.0, 91: 0.0, 13: lat, 14: lon, 104: height_m, 18: 0.0, 19: -30.0, 20: 0.0,
            **{int(name[1:]): value for name, value in more.items()}}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Part:
    """One PES packet of a stream: its bytes, and its PTS in seconds if it has one."""

    pid: int
    content: bytes
    pts_s: float | None
    key_frame: bool = False
    stream: int = 0xBD


def pes(part: Part) -> bytes:
    head = b"\x80\x00\x00"
    if part.pts_s is not None:
        pts = round(part.pts_s * 90_000) % (1 << 33)
        marks = [
            0x21 | (pts >> 29 & 0x0E),
            pts >> 22 & 0xFF,
            1 | (pts >> 14 & 0xFE),
            pts >> 7 & 0xFF,
            1 | (pts << 1 & 0xFE),
        ]
        head = b"\x80\x80\x05" + bytes(marks)
    content = head + part.content
    length = len(content) if len(content) < 65536 else 0
    return b"\0\0\1" + bytes([part.stream]) + length.to_bytes(2, "big") + content


def packets(pid: int, content: bytes, *, key_frame: bool = False, counter: int = 0) -> list[bytes]:
    """A PES packet or section as packets of 188 bytes, the last one stuffed."""
    found, begins = [], True
    while content or begins:
        flags = b"\x40" if begins and key_frame else b"\x00"
        field = b"\x01" + flags if begins and key_frame else b""
        room = 184 - len(field)
        if len(content) < room:
            missing = 184 - len(content)
            field = bytes([missing - 1]) + (flags + b"\xff" * (missing - 2) if missing > 1 else b"")
            room = len(content)
        head = bytes([0x47, (0x40 if begins else 0) | pid >> 8, pid & 0xFF, (0x30 if field else 0x10) | counter & 15])
        found.append(head + field + content[:room])
        content, begins, counter = content[room:], False, counter + 1
    return found


def tables(streams: Mapping[int, int]) -> list[bytes]:
    """Program association and map: PID -> stream type."""
    entries = b""
    for pid, kind in streams.items():
        said = b"\x05\x04KLVA" if kind in (0x06, 0x15) else b""
        entries += bytes([kind]) + (0xE000 | pid).to_bytes(2, "big") + (0xF000 | len(said)).to_bytes(2, "big") + said
    found = []
    for pid, table, body in (
        (0, 0, b"\0\1" + (0xE000 | MAP_PID).to_bytes(2, "big")),
        (MAP_PID, 2, (0xE000 | VIDEO_PID).to_bytes(2, "big") + b"\xf0\0" + entries),
    ):
        rest = b"\0\1\xc1\0\0" + body
        section = bytes([table]) + (0xB000 | (len(rest) + 4)).to_bytes(2, "big") + rest + b"CRC!"
        found += packets(pid, b"\0" + section + b"\xff" * (183 - len(section)))
    return found


def cell(content: bytes, number: int = 0) -> bytes:
    """A metadata access unit cell: service, number, "whole", length."""
    return bytes([0, number & 255, 0xDF]) + len(content).to_bytes(2, "big") + content


def transport(
    path: Path, parts: Iterable[Part], *, kinds: Mapping[int, int] | None = None, stride: int = 188, lead: bytes = b""
) -> Path:
    """A transport stream of parts in their order: video at VIDEO_PID (H.264), metadata as `kinds` says."""
    kinds = {VIDEO_PID: 0x1B, 0x102: 0x06} if kinds is None else kinds
    found = tables(kinds)
    for part in parts:
        found += packets(part.pid, pes(part), key_frame=part.key_frame)
    before, behind = (b"\0\0\0\0", b"") if stride == 192 else (b"", b"\0" * (stride - 188))
    path.write_bytes(lead + b"".join(before + packet + behind for packet in found))
    return path


def flight(
    sets: Sequence[bytes],
    *,
    first_pts_s: float = 10.0,
    rate_hz: float = 10.0,
    kind: int = 0x06,
    stamped: bool = True,
    late_s: float = 0.0,
    pid: int = 0x102,
) -> list[Part]:
    """Sets at `rate_hz`, each `late_s` after a frame of the video."""
    parts = []
    for i, content in enumerate(sets):
        at = first_pts_s + i / rate_hz
        parts.append(Part(pid=VIDEO_PID, content=b"frame", pts_s=at, key_frame=i == 0, stream=0xE0))
        parts.append(
            Part(pid=pid, content=cell(content, i) if kind == 0x15 else content, pts_s=at + late_s if stamped else None,
                 stream=0xFC if kind == 0x15 else 0xBD)
        )  # fmt: skip
    return parts
