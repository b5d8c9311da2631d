"""An MPEG transport stream (ISO/IEC 13818-1): its metadata as bytes, each part with the video's clock beside it.

    packets of 188 bytes (192 with a disk's time code, 204 with error correction) -> PID
    PID 0: program association -> program map -> the streams and what they are
    packets of one PID -> packetized elementary stream (PES): presentation time stamp (PTS, 90 kHz) and payload

Metadata is private data (stream type 0x06, "asynchronous": its PTS, if it has one, is only near) or metadata in PES
(0x15, "synchronous": access units whose PTS is that of their frame), as MISB ST 1402 has it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from calibration.foundation.errors import InputFileError
from pipeline.telemetry.log.mapped_file import Bytes, mapped

Rows = npt.NDArray[np.uint8]
SYNC, PACKET, STRIDES = 0x47, 188, (188, 192, 204)
BLOCK_PACKETS = 1 << 15
TABLES_WITHIN = 1 << 26
"""Bytes in which the tables of the stream have to come; they come ten times a second."""
VIDEO_TYPES = frozenset((0x01, 0x02, 0x10, 0x1B, 0x20, 0x24, 0x33, 0xD1, 0xEA))
PRIVATE, METADATA = 0x06, 0x15
PTS_HZ, PTS_ROUND = 90_000, 1 << 33
NO_KEY_FRAME_WITHIN = 300
"""Parts of a video, none of which is flagged as one to begin at, after which no flag is expected."""


@dataclass(kw_only=True)
class MetadataStream:
    """One stream of metadata: `data`, its parts one after the other; where each begins in it; and its time."""

    synchronous: bool
    data: bytearray = field(default_factory=bytearray)
    begin: list[int] = field(default_factory=list)
    pts: list[int | None] = field(default_factory=list)
    beside: list[int | None] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Transport:
    """What a transport stream holds.

    streams   by PID
    first_pts of the video's first frame, 90 kHz; None where there is none
    broken    places where packets were out of step
    """

    streams: dict[int, MetadataStream]
    first_pts: int | None
    broken: int


def is_transport(data: Bytes) -> bool:
    """Whether bytes are a transport stream: packets of one length, each with its sync byte."""
    return _layout(data) is not None


def read_transport(path: Path) -> Transport:
    """The metadata of the transport stream at `path`. Raises InputFileError where it is none."""
    data = mapped(path, expected="an MPEG transport stream")
    layout = _layout(data)
    if layout is None:
        raise InputFileError(
            where=str(path), seen="no MPEG transport stream", expected="a .ts file", advice="copy the video again"
        )
    types = _streams_of(data, layout)
    video = next((pid for pid, kind in types.items() if kind in VIDEO_TYPES), None)
    streams = {pid: MetadataStream(synchronous=kind == METADATA) for pid, kind in types.items()
               if kind in (PRIVATE, METADATA)}  # fmt: skip
    reader = _Reader(streams=streams, video=video)
    broken = 0
    for rows, torn in _blocks(data, layout):
        broken += torn
        pid = (rows[:, 1] & 0x1F).astype(np.int64) << 8 | rows[:, 2]
        begins = (rows[:, 1] & 0x40) != 0
        wanted = np.isin(pid, list(streams)) | ((pid == (-1 if video is None else video)) & begins)
        for at in np.flatnonzero(wanted & ((rows[:, 1] & 0x80) == 0)).tolist():
            reader.take(int(pid[at]), rows[at].tobytes(), begins=bool(begins[at]))
    reader.end()
    return Transport(streams=streams, first_pts=reader.first_pts, broken=broken)


class _Reader:
    """Packets of the wanted streams in the order of the file: PES parts put together, PTS read."""

    def __init__(self, *, streams: dict[int, MetadataStream], video: int | None) -> None:
        self._streams, self._video = streams, video
        self._open: dict[int, bytearray] = {}
        self._beside: dict[int, int | None] = {}
        self._seen = 0
        self._earliest: int | None = None
        self._latest: int | None = None
        self._keyed = False

    @property
    def first_pts(self) -> int | None:
        """PTS of the video's first frame: of the first that is flagged as one to begin at, else of the first."""
        return self._earliest

    def take(self, pid: int, packet: bytes, *, begins: bool) -> None:
        """One packet."""
        flags, at = packet[3], 4
        random_access = False
        if flags & 0x20:
            random_access = packet[4] > 0 and bool(packet[5] & 0x40)
            at = 5 + packet[4]
        if not flags & 0x10 or at >= PACKET:
            return
        payload = packet[at:]
        if pid == self._video:
            self._frame(payload, random_access=random_access)
            return
        if begins:
            self._finish(pid)
            self._open[pid], self._beside[pid] = bytearray(), self._latest
        if pid in self._open:
            self._open[pid] += payload

    def end(self) -> None:
        """What is still open is whole."""
        for pid in list(self._open):
            self._finish(pid)

    def _frame(self, payload: bytes, *, random_access: bool) -> None:
        pts = pts_of(payload)
        if pts is None:
            return
        self._latest = pts
        self._seen += 1
        if random_access and not self._keyed and self._seen <= NO_KEY_FRAME_WITHIN:
            self._earliest, self._keyed = pts, True
        elif self._earliest is None:
            self._earliest = pts

    def _finish(self, pid: int) -> None:
        part = bytes(self._open.pop(pid, b""))
        content = payload_of(part)
        if not content:
            return
        stream = self._streams[pid]
        if stream.synchronous:
            content = access_units(content)
        stream.begin.append(len(stream.data))
        stream.pts.append(pts_of(part))
        stream.beside.append(self._beside[pid])
        stream.data += content


def pts_of(pes: bytes) -> int | None:
    """The presentation time stamp in the head of a PES packet, 90 kHz; None where it has none."""
    if len(pes) < 14 or pes[:3] != b"\0\0\1" or pes[6] & 0xC0 != 0x80 or not pes[7] & 0x80:
        return None
    a, b, c, d, e = pes[9:14]
    return (a >> 1 & 7) << 30 | b << 22 | (c >> 1) << 15 | d << 7 | e >> 1


def payload_of(pes: bytes) -> bytes:
    """What a PES packet carries; empty where it is none."""
    if len(pes) < 9 or pes[:3] != b"\0\0\1" or pes[6] & 0xC0 != 0x80:
        return b""
    length = int.from_bytes(pes[4:6], "big")
    end = 6 + length if length else len(pes)
    return pes[9 + pes[8] : end]


def access_units(content: bytes) -> bytes:
    """Metadata without the heads of its access unit cells (five bytes: service, number, flags, length)."""
    found, at = bytearray(), 0
    while at + 5 <= len(content):
        if content[at : at + 4] == b"\x06\x0e\x2b\x34":  # written without cells
            return bytes(found) + content[at:]
        length = int.from_bytes(content[at + 3 : at + 5], "big")
        found += content[at + 5 : at + 5 + length]
        at += 5 + length
    return bytes(found)


def seconds_between(first_pts: int, pts: int) -> float:
    """How much later `pts` is, also where the 33 bits of the clock began anew between the two."""
    late = (pts - first_pts) % PTS_ROUND
    return (late - PTS_ROUND if late >= PTS_ROUND // 2 else late) / PTS_HZ


def _layout(data: Bytes) -> tuple[int, int] | None:
    """Where the first packet's sync byte is and how far apart they are; None where bytes are no transport stream."""
    head = bytes(data[: 12 * max(STRIDES)])
    for stride in STRIDES:
        for first in range(min(stride, len(head))):
            at = range(first, len(head), stride)
            if len(at) >= 5 and all(head[i] == SYNC for i in at):
                return first, stride
    return None


def _blocks(data: Bytes, layout: tuple[int, int], end: int | None = None) -> Iterator[tuple[Rows, int]]:
    """Packets (n, 188) in the order of the file, and how often they were out of step before these."""
    first, stride = layout
    source = np.frombuffer(data, np.uint8)[: end or len(data)]
    at, torn = first, 0
    while at + PACKET <= len(source):
        many = min(BLOCK_PACKETS, (len(source) - at - PACKET) // stride + 1)
        windows = np.lib.stride_tricks.as_strided(source[at:], (many, PACKET), (stride, 1), writeable=False)
        wrong = np.flatnonzero(windows[:, 0] != SYNC)
        good = int(wrong[0]) if len(wrong) else many
        if good:
            yield windows[:good], torn
            torn = 0
        at += good * stride
        if good < many:
            torn = 1
            at = _next_sync(source, at + 1, stride)


def _next_sync(source: Rows, at: int, stride: int) -> int:
    """The next place from which sync bytes follow each other again, or the end."""
    for begin in range(at, len(source), 1 << 16):
        found = begin + np.flatnonzero(source[begin : begin + (1 << 16)] == SYNC)
        for step in (1, 2):
            found = found[found + step * stride < len(source)]
            found = found[source[found + step * stride] == SYNC]
        if len(found):
            return int(found[0])
    return len(source)


def _streams_of(data: Bytes, layout: tuple[int, int]) -> dict[int, int]:
    """PID -> stream type, of every program."""
    maps: dict[int, bool] = {}
    found: dict[int, int] = {}
    for rows, _ in _blocks(data, layout, TABLES_WITHIN):
        pid = (rows[:, 1] & 0x1F).astype(np.int64) << 8 | rows[:, 2]
        for at in np.flatnonzero((pid == 0) & ((rows[:, 1] & 0x40) != 0)).tolist():
            maps |= {p: maps.get(p, False) for p in _programs(_section(rows[at].tobytes(), 0x00))}
        for at in np.flatnonzero(np.isin(pid, list(maps)) & ((rows[:, 1] & 0x40) != 0)).tolist():
            streams = _map(_section(rows[at].tobytes(), 0x02))
            if streams:
                found |= streams
                maps[int(pid[at])] = True
        if maps and all(maps.values()):
            break
    return found


def _section(packet: bytes, table: int) -> bytes:
    """The section of a table that begins in a packet, without its checksum; empty where it is another, or longer."""
    at = 4 + (1 + packet[4] if packet[3] & 0x20 else 0)
    if at >= PACKET:
        return b""
    at += 1 + packet[at]
    section = packet[at:]
    if len(section) < 12 or section[0] != table:
        return b""
    length = 3 + (int.from_bytes(section[1:3], "big") & 0x0FFF)
    return section[: length - 4] if length <= len(section) else b""


def _programs(section: bytes) -> list[int]:
    """The PIDs of the program maps; program 0 is the network's."""
    entries = (section[at : at + 4] for at in range(8, len(section) - 3, 4))
    return [int.from_bytes(e[2:], "big") & 0x1FFF for e in entries if e[:2] != b"\0\0"]


def _map(section: bytes) -> dict[int, int]:
    """PID -> stream type of one program."""
    found: dict[int, int] = {}
    at = 12 + (int.from_bytes(section[10:12], "big") & 0x0FFF) if section else 0
    while 0 < at <= len(section) - 5:
        found[int.from_bytes(section[at + 1 : at + 3], "big") & 0x1FFF] = section[at]
        at += 5 + (int.from_bytes(section[at + 3 : at + 5], "big") & 0x0FFF)
    return found
