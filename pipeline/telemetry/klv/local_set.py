"""The UAS Datalink Local Set (MISB ST 0601) in a run of bytes: keys, lengths, values, checksums.

    universal key (16 bytes)  length (BER)  { item (BER-OID)  length (BER)  value } ...  item 1: checksum

The checksum is the 16-bit sum of all 16-bit words from the key to the checksum's own length.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

UNIVERSAL_KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
CHECKSUM = 1


@dataclass(frozen=True, kw_only=True)
class LocalSet:
    """One set: where its key begins, and item -> value."""

    begin: int
    items: Mapping[int, bytes]


@dataclass(frozen=True, kw_only=True)
class Sets:
    """The whole sets of a run of bytes, how many were broken, and how many had no checksum to tell."""

    sets: tuple[LocalSet, ...]
    corrupt: int
    unchecked: int


def local_sets(data: bytes) -> Sets:
    """Every set whose length and checksum are right."""
    found, corrupt, unchecked, at = [], 0, 0, data.find(UNIVERSAL_KEY)
    while at >= 0:
        parsed = _set_at(data, at)
        if parsed is None:
            corrupt += 1
            after = at + len(UNIVERSAL_KEY)
        else:
            items, after = parsed
            unchecked += CHECKSUM not in items
            found.append(LocalSet(begin=at, items=items))
        at = data.find(UNIVERSAL_KEY, after)
    return Sets(sets=tuple(found), corrupt=corrupt, unchecked=unchecked)


def checksum(data: bytes) -> int:
    """The 16-bit sum of big-endian 16-bit words; an odd last byte is the high one of a word."""
    words = np.frombuffer(data + b"\0" * (len(data) % 2), ">u2")
    return int(words.astype(np.int64).sum()) & 0xFFFF


def _set_at(data: bytes, begin: int) -> tuple[dict[int, bytes], int] | None:
    """The items of the set whose key is at `begin`, and where it ends; None where it is broken."""
    length, at = _ber(data, begin + len(UNIVERSAL_KEY))
    end = at + length
    if length < 0 or end > len(data):
        return None
    items: dict[int, bytes] = {}
    while at < end:
        item, at = _oid(data, at, end)
        size, at = _ber(data, at)
        if item < 0 or size < 0 or at + size > end:
            return None
        if item == CHECKSUM and (size != 2 or int.from_bytes(data[at : at + 2], "big") != checksum(data[begin:at])):
            return None
        items[item] = data[at : at + size]
        at += size
    return items, end


def _ber(data: bytes, at: int) -> tuple[int, int]:
    """A length, and what follows it; -1 where there is none of at most four bytes."""
    if at >= len(data):
        return -1, at
    first = data[at]
    if first < 0x80:
        return first, at + 1
    many = first & 0x7F
    if not 1 <= many <= 4 or at + 1 + many > len(data):
        return -1, at
    return int.from_bytes(data[at + 1 : at + 1 + many], "big"), at + 1 + many


def _oid(data: bytes, at: int, end: int) -> tuple[int, int]:
    """An item's number, seven bits a byte, and what follows it; -1 where it does not end in the set."""
    number = 0
    while at < end:
        number = number << 7 | data[at] & 0x7F
        at += 1
        if not data[at - 1] & 0x80:
            return number, at
    return -1, at
