"""Where the MAVLink packets of a log are, each with its checksum verified.

A packet is FE length seq system component id payload crc (v1), or FD length flags flags seq system component id(3)
payload crc [13 bytes signature] (v2). The checksum is X.25 over everything between the marker and itself, and over
one byte that depends on the id; 8 bytes of the recorder's clock stand before it in a `.tlog`. A checksum has 16 bits
and garbage has many markers, so a packet found among garbage must have more for it: a packet after it, a sender
already known, or a recorder's time close to the last; and one that runs into a good packet is not believed. Numba
compiles this file: everything is a bare array.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.foundation.compiled import loop
from pipeline.telemetry.mavlink.packets.walk import AT, CORRUPT, IDS, LAST_US, PLACE, STRANGE, V1, V2

SIGNED = 1
IN_A_ROW = 4
"""Packets with the right checksum that follow each other: by chance they never do."""
CLOSE_US = 3 * 86_400 * 1_000_000
GOOD, UNKNOWN, BAD = 1, 0, -1

CRC_TABLE = np.zeros((4, 256), dtype=np.int64)
"""X.25 of a byte, and of a byte with one, two, three zero bytes behind it: four bytes are taken at a time."""
for _byte in range(256):
    _crc = _byte
    for _ahead in range(4):
        for _ in range(8):
            _crc = (_crc >> 1) ^ 0x8408 if _crc & 1 else _crc >> 1
        CRC_TABLE[_ahead, _byte] = _crc


@loop
def packet_bytes(data: Any, size: int, at: int) -> int:
    """Length of the packet whose marker is at `at`, signature included; 0 where none can be."""
    if at + 8 > size:
        return 0
    if data[at] == V1:
        total = 8 + int(data[at + 1])
    elif data[at] == V2 and data[at + 2] & ~SIGNED == 0:
        total = 12 + int(data[at + 1]) + 13 * int(data[at + 2])
    else:
        return 0
    return total if at + total <= size else 0


@loop
def packet_id(data: Any, at: int) -> int:
    """Message id of the packet at `at`."""
    if data[at] == V1:
        return int(data[at + 5])
    return int(data[at + 7]) | int(data[at + 8]) << 8 | int(data[at + 9]) << 16


@loop
def checked(data: Any, at: int, total: int, extra: Any, table: Any) -> int:
    """GOOD, BAD, or UNKNOWN where the id is not defined and so the checksum cannot be known."""
    msgid = packet_id(data, at)
    if msgid >= IDS or extra[msgid] < 0:
        return UNKNOWN
    signature = 13 if data[at] == V2 and data[at + 2] & SIGNED else 0
    end = at + total - 2 - signature
    crc, i = 0xFFFF, at + 1
    while i + 4 <= end:
        low, high = (crc ^ int(data[i])) & 0xFF, crc >> 8 ^ int(data[i + 1])
        crc = table[3, low] ^ table[2, high] ^ table[1, data[i + 2]] ^ table[0, data[i + 3]]
        i += 4
    while i < end:
        crc = crc >> 8 ^ table[0, (crc ^ int(data[i])) & 0xFF]
        i += 1
    crc = crc >> 8 ^ table[0, (crc ^ int(extra[msgid])) & 0xFF]
    return GOOD if crc == int(data[end]) | int(data[end + 1]) << 8 else BAD


@loop
def stamp_us(data: Any, at: int, stamped: int) -> int:
    """The recorder's time before the packet at `at`; -1 where there is none."""
    if stamped == 0 or at < 8:
        return -1
    value = 0
    for i in range(at - 8, at):
        value = value << 8 | int(data[i])
    return value


@loop
def sender(data: Any, at: int) -> int:
    """System and component as one number."""
    first = at + (3 if data[at] == V1 else 5)
    return int(data[first]) << 8 | int(data[first + 1])


@loop
def next_packet(data: Any, size: int, at: int, stamped: int, extra: Any, table: Any, known: Any, last_us: int) -> int:
    """Marker of the first packet from `at` on that can be believed without one before it; `size` if none."""
    while at + 8 <= size:
        total = packet_bytes(data, size, at)
        if total > 0 and checked(data, at, total, extra, table) == GOOD:
            if known[sender(data, at)]:
                return at
            following = at + total + 8 * stamped
            if packet_bytes(data, size, following) > 0:
                return at
            time = stamp_us(data, at, stamped)
            if last_us >= 0 and time >= 0 and abs(time - last_us) < CLOSE_US:
                return at
        at += 1
    return size


@loop
def first_due(data: Any, size: int, at: int, stop: int, stamped: int, extra: Any, table: Any) -> int:
    """Where, from `at` on, the first of IN_A_ROW good packets is due, its stamp first; `stop` if nowhere before it."""
    for due in range(at, stop):
        following, good = due, 0
        while good < IN_A_ROW and following < size:
            marker = following + 8 * stamped
            total = packet_bytes(data, size, marker)
            if total == 0 or checked(data, marker, total, extra, table) != GOOD:
                break
            following, good = marker + total, good + 1
        if good == IN_A_ROW or (good > 0 and following == size):
            return due
    return stop


@loop
def swallows(data: Any, size: int, at: int, total: int, stamped: int, extra: Any, table: Any, known: Any) -> bool:
    """Whether the packet at `at`, behind which none follows, was cut off and runs into a good packet of a known sender.

    One cut in 65536 has a checksum that fits by chance.
    """
    following = at + total + 8 * stamped
    if following >= size or packet_bytes(data, size, following) > 0:
        return False
    for inner in range(at + 8, at + total):
        inside = packet_bytes(data, size, inner)
        if inside > 0 and inner + inside > at + total and known[sender(data, inner)]:  # noqa: SIM102
            if checked(data, inner, inside, extra, table) == GOOD:
                return True
    return False


@loop
def walked(data: Any, size: int, at: int, stop: int, stamped: int) -> int:
    """How many packets, whole but wrong, stand between `at` and `stop`; bytes that are no packet count as one."""
    count = 0
    while at < stop:
        total = packet_bytes(data, size, at)
        count += 1 if total > 0 else 0
        at += total + 8 * stamped if total > 0 else 1
    return max(count, 1)


@loop
def scan_packets(
    data: Any, size: int, stop: int, stamped: int, extra: Any, wanted: Any, table: Any,
    counts: Any, known: Any, rows: Any, state: Any,
) -> int:  # fmt: skip
    """Packets of the wanted ids from state[AT] on, as many as `rows` has room for; returns how many.

    stop     where no packet is begun any more; `size` for all of the file
    stamped  1 where 8 bytes of time stand before every packet
    extra    (IDS,) last byte of each id's checksum, -1 for ids that are not defined
    wanted   (IDS,) true for ids to list
    counts   (IDS,) is added to
    known    (IDS,) true for senders (system * 256 + component) met in step
    rows     (n, 5) marker, packet bytes, id, recorder's microseconds (-1: none), place among all packets
    state    (5,) where the next packet (its stamp first) is due, corrupt packets, last time, packets so far, packets
             of ids that are not defined
    """
    at, corrupt, last_us, place = state[AT], state[CORRUPT], state[LAST_US], state[PLACE]
    found, room = 0, len(rows)
    while at < stop and found < room:
        marker = at + 8 * stamped
        total = packet_bytes(data, size, marker)
        verdict = BAD if total == 0 else checked(data, marker, total, extra, table)
        if verdict == UNKNOWN:
            following = marker + total + 8 * stamped
            if following < size + 8 * stamped and packet_bytes(data, size, following) == 0:
                verdict = BAD
        begin = at
        if verdict == GOOD and swallows(data, size, marker, total, stamped, extra, table, known):
            verdict, begin = BAD, marker + 1
        if verdict == BAD:
            resume = next_packet(data, size, begin, stamped, extra, table, known, last_us)
            corrupt += walked(data, size, marker, resume if resume < size else size + 8 * stamped, stamped)
            if resume == size:
                at = size
                break
            marker = resume
            total = packet_bytes(data, size, marker)
            verdict = GOOD
        place += 1
        state[STRANGE] += 1 if verdict == UNKNOWN else 0
        if verdict == GOOD:
            msgid = packet_id(data, marker)
            counts[msgid] += 1
            known[sender(data, marker)] = True
            time = stamp_us(data, marker, stamped)
            last_us = time if time >= 0 else last_us
            if wanted[msgid]:
                rows[found, 0], rows[found, 1], rows[found, 2], rows[found, 3], rows[found, 4] = (
                    marker,
                    total,
                    msgid,
                    time,
                    place,
                )
                found += 1
        at = marker + total
    state[AT], state[CORRUPT], state[LAST_US], state[PLACE] = at, corrupt, last_us, place
    return found
