"""MAVLink logs read by compiled loops: scan once, verify every checksum, gather only the wanted fields.

Layouts are those of pymavlink's own message definitions, so the values are bit for bit those of its reader.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Floats, Ints
from pipeline.telemetry.log.byte_ranges import Pieces, bytes_in, share_read
from pipeline.telemetry.log.flight_log import LogFormat
from pipeline.telemetry.log.mapped_file import Bytes, mapped, taken
from pipeline.telemetry.log.tables import Column, Growing, MessageTable, Progress, RawLog
from pipeline.telemetry.mavlink.packets.definitions import definitions
from pipeline.telemetry.mavlink.packets.names import WANTED, has_stamps
from pipeline.telemetry.mavlink.packets.walk import AT, CORRUPT, IDS, PLACE, STRANGE, V1, walk_packets

TYPES = {
    "char": "S1", "uint8_t": "u1", "int8_t": "i1", "uint16_t": "<u2", "int16_t": "<i2", "uint32_t": "<u4",
    "int32_t": "<i4", "uint64_t": "<u8", "int64_t": "<i8", "float": "<f4", "double": "<f8",
}  # fmt: skip
CHUNK = 1 << 18
SMALL_BYTES = 1 << 24
"""Up to here plain numpy is through before the compiled loops are loaded, where they are not yet."""
_walked_bytes = 0
"""By plain numpy so far: a process that reads one log after the other soon gets the compiled loops."""


def read_mavlink_fast(
    path: Path,
    *,
    wanted: tuple[str, ...] = WANTED,
    fields: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    pieces: Pieces | None = None,
    progress: Progress = None,
) -> RawLog:
    """Every message of the `wanted` names in a `.tlog` or raw MAVLink file, or in `pieces` of it.

    `fields` says which columns of a message are kept, where not all of them; memory grows with what is kept, not with
    the file. A piece is read from the first of its packets that others follow to the last that begins in it; places
    in it count from the piece's first byte. Raises InputFileError where the file is missing or cannot be read.
    """
    data = mapped(path, expected="a MAVLink log")
    stamped = has_stamps(data, path)
    found, counts, state = _scan(data, stamped, wanted, fields, pieces or ((0, len(data)),), progress)
    kind: LogFormat = "tlog" if stamped else "mavlink"
    names = definitions()
    return RawLog(
        path=path,
        format=kind,
        tables={names[msgid].msgname: found[msgid].whole() for msgid in sorted(found)},
        counts={names[int(i)].msgname: int(counts[i]) for i in np.flatnonzero(counts)},
        corrupt_packets=int(state[CORRUPT]),
        notes=(f"{state[STRANGE]} packets have ids that no known dialect defines",) if state[STRANGE] else (),
        bytes_read=bytes_in(pieces or ()),
    )


@cache
def layout(message: Any) -> np.dtype[np.void]:
    """A message's payload as it is sent: fields by size, extensions last."""
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    members: list[tuple[str, Any]] = []
    for name, many in zip(message.ordered_fieldnames, message.array_lengths, strict=True):
        base = TYPES[types[name]]
        members.append((name, f"S{many}" if base == "S1" and many else (base, (many,)) if many else base))
    return np.dtype(members)


@cache
def _extra() -> Ints:
    extra = np.full(IDS, -1, dtype=np.int64)
    for msgid, message in definitions().items():
        extra[msgid] = message.crc_extra
    return extra


def _scan(
    data: Bytes, stamped: bool, wanted: tuple[str, ...], fields: Mapping[str, tuple[str, ...]], pieces: Pieces,
    progress: Progress,
) -> tuple[dict[int, Growing], Ints, Ints]:  # fmt: skip
    """Each wanted id's table, counts by id, and the final state of `scan_packets`."""
    names = definitions()
    listed = np.zeros(IDS, dtype=np.bool_)
    listed[[msgid for msgid, message in names.items() if message.msgname in wanted]] = True
    counts, known = np.zeros(IDS, dtype=np.int64), np.zeros(IDS, dtype=np.bool_)
    state = np.array([0, 0, -1, 0, 0], dtype=np.int64)
    source = np.frombuffer(data, np.uint8)
    tables: dict[int, Growing] = {}

    def keep(found: Ints) -> None:
        share = share_read(pieces, int(state[AT]))
        order = np.argsort(found[:, 2].astype(np.uint16), kind="stable")  # of 16 bits: by their digits
        ids = found[order, 2]
        for rows in np.split(order, np.flatnonzero(np.diff(ids)) + 1) if len(found) else []:
            msgid = int(found[rows[0], 2])
            message = names[msgid]
            kept = fields.get(message.msgname, tuple(message.fieldnames))
            piece = _table(source, message, found[rows], kept)
            if msgid in tables:
                tables[msgid].add(piece, share)
            else:
                tables[msgid] = Growing(piece)
        if progress is not None:
            progress(share)

    global _walked_bytes
    small = pieces == ((0, len(data)),) and _walked_bytes + len(data) <= SMALL_BYTES
    if small and f"{__package__}.scan" not in sys.modules:
        _walked_bytes += len(data)
        keep(walk_packets(data[:], int(stamped), _extra(), listed, counts, known, state))
    for begin, stop in pieces:
        if state[AT] < stop:
            from pipeline.telemetry.mavlink.packets.scan import (  # numba is slow to import
                CRC_TABLE,
                first_due,
                scan_packets,
            )

            if state[AT] < begin:
                state[AT] = first_due(source, len(data), begin, stop, int(stamped), _extra(), CRC_TABLE)
                state[PLACE] = begin
            room = np.empty((CHUNK, 5), dtype=np.int64)
            while state[AT] < stop:
                n = scan_packets(
                    source, len(data), stop, int(stamped), _extra(), listed, CRC_TABLE, counts, known, room, state
                )
                keep(room[:n])
    return tables, counts, state


def _table(source: npt.NDArray[np.uint8], message: Any, rows: Ints, kept: tuple[str, ...]) -> MessageTable:
    form = layout(message)
    payload = _payloads(source, rows, form.itemsize)
    values = payload.view(form)[:, 0]
    sender = rows[:, 0] + np.where(source[rows[:, 0]] == V1, 3, 5)
    return MessageTable(
        name=message.msgname,
        place=rows[:, 4].copy(),
        record_time_s=_record_time(rows[:, 3]),
        system=source[sender],
        component=source[sender + 1],
        columns={name: _owned(values[name]) for name in kept},
    )


def _payloads(source: npt.NDArray[np.uint8], rows: Ints, many: int) -> npt.NDArray[np.uint8]:
    """Payloads (n, many) of packets `rows`: cut where longer, zero where shorter (v2 drops zeros)."""
    first = rows[:, 0] + np.where(source[rows[:, 0]] == V1, 6, 10)
    have = source[rows[:, 0] + 1]
    payload = np.zeros((len(rows), many), dtype=np.uint8)
    for length in np.flatnonzero(np.bincount(have)).tolist():
        which, kept = np.flatnonzero(have == length), min(length, many)
        if kept:
            payload[which, :kept] = taken(source, first[which], kept).view(np.uint8).reshape(-1, kept)
    return payload


def _record_time(stamp_us: Ints) -> Floats:
    return np.where(stamp_us >= 0, stamp_us.astype(float) * 1e-6, np.nan)


def _owned(column: Column) -> Column:
    return np.ascontiguousarray(column)
