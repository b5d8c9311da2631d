"""The undamaged start of a small MAVLink log by numpy: sooner done than a compiler is loaded.

Where each packet begins is the only loop; the checksums of all packets of one length are then taken together, two
bytes a step. What the walk accepts is what `mavlink_scan` accepts; it stops at the first packet that needs a closer
look.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Ints
from pipeline.telemetry.log.mapped_file import taken

V1, V2 = 0xFE, 0xFD
AT, CORRUPT, LAST_US, PLACE, STRANGE = 0, 1, 2, 3, 4
IDS = 1 << 16
"""Ids from here on are looked up as unknown: no dialect that pymavlink carries has them."""
Bytes = npt.NDArray[np.uint8]
Words = npt.NDArray[np.uint16]


def walk_packets(
    data: bytes, stamped: int, extra: Ints, wanted: Bools, counts: Ints, known: Bools, state: Ints
) -> Ints:
    """Rows (n, 5) of the wanted packets up to the first that needs a closer look, where `state` is left.

    Arguments and rows are those of `mavlink_scan.scan_packets`; the walk starts at the file's beginning.
    """
    source, gap = np.frombuffer(data, np.uint8), 8 * stamped
    marker, due = _markers(data, gap)
    version, spacing = source[marker], np.diff(marker, append=due)
    ids = _ids(source, marker, version)
    strange = (ids >= len(extra)) | (extra[np.minimum(ids, len(extra) - 1)] < 0)
    good = strange | _checked(source, marker, spacing - gap, np.where(strange, 0, extra[np.where(strange, 0, ids)]))
    n = len(good) if good.all() else int(np.argmin(good))
    state[AT] = min(int(marker[n]) - gap if n < len(marker) else due - gap, len(data))
    state[PLACE] += n
    state[STRANGE] += int(strange[:n].sum())
    rows = np.stack([marker, spacing - gap, ids, np.full(len(marker), -1), 1 + np.arange(len(marker))], axis=1)[:n]
    rows = rows[~strange[:n]]
    counts += np.bincount(rows[:, 2], minlength=len(counts))
    first = rows[:, 0] + np.where(source[rows[:, 0]] == V1, 3, 5)
    known[source[first].astype(np.int64) << 8 | source[first + 1]] = True
    if stamped and len(rows):
        stamps = taken(source, rows[:, 0] - 8, 8).view(">u8")
        rows[:, 3] = np.maximum(stamps.astype(np.int64), -1)
        told = np.flatnonzero(rows[:, 3] >= 0)
        state[LAST_US] = rows[told[-1], 3] if len(told) else state[LAST_US]
    return np.asarray(rows[wanted[rows[:, 2]]])


def _markers(data: bytes, gap: int) -> tuple[Ints, int]:
    """Markers of packets that follow each other from the file's beginning, and where the next one is due.

    A packet that neither another one nor the file's end follows is left out.
    """
    size, at = len(data), gap
    found: list[int] = []
    add = found.append
    while at + 12 <= size:  # a shorter packet, of version 1 and without payload, needs the closer look
        if data[at] == V2 and data[at + 2] <= 1:
            total = 12 + data[at + 1] + 13 * data[at + 2]
        elif data[at] == V1:
            total = 8 + data[at + 1]
        else:
            break
        if at + total > size:
            break
        add(at)
        at += total + gap
    if found and at != size + gap:
        at = found.pop()
    return np.array(found, dtype=np.int64), at


def _ids(source: Bytes, marker: Ints, version: Bytes) -> Ints:
    low, middle, high = (source[marker + i].astype(np.int64) for i in (7, 8, 9))
    return np.where(version == V1, source[marker + 5].astype(np.int64), low | middle << 8 | high << 16)


def _checked(source: Bytes, marker: Ints, total: Ints, extra: Ints) -> Bools:
    """Whether the checksum of each packet (n,) is right, `extra` (n,) being its id's last byte."""
    version = source[marker]
    signed = (version == V2) & (source[marker + 2] == 1)
    covered = total - 3 - np.where(signed, 13, 0)
    good = np.zeros(len(marker), dtype=np.bool_)
    for length in np.flatnonzero(np.bincount(covered)).tolist():
        which = np.flatnonzero(covered == length)
        body = taken(source, marker[which] + 1, length + 2).view(np.uint8).reshape(-1, length + 2)
        sent = body[:, length] | body[:, length + 1].astype(np.uint16) << 8
        body[:, length] = extra[which]
        good[which] = _x25(body[:, : length + 1]) == sent
    return good


def _x25(body: Bytes) -> Words:
    """The checksum X.25 of each row (n, k)."""
    table = _two_bytes()
    crc = np.full(len(body), 0xFFFF, dtype=np.uint16)
    odd = body.shape[1] % 2
    if odd:
        low = (crc ^ body[:, 0]) & np.uint16(0xFF)
        crc = crc >> np.uint16(8) ^ _one_byte()[low]
    for word in np.ascontiguousarray(body[:, odd:].T).reshape(-1, 2, len(body)):
        crc = table[crc ^ (word[0] | word[1].astype(np.uint16) << np.uint16(8))]
    return crc


@cache
def _one_byte() -> Words:
    crc = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        crc = np.where(crc & 1, crc >> 1 ^ 0x8408, crc >> 1).astype(np.uint16)
    return crc


@cache
def _two_bytes() -> Words:
    one, word = _one_byte(), np.arange(1 << 16, dtype=np.uint16)
    half = word >> np.uint16(8) ^ one[word & np.uint16(0xFF)]
    return np.asarray(half >> np.uint16(8) ^ one[half & np.uint16(0xFF)], dtype=np.uint16)
