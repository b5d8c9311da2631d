"""MAVLink logs read message by message with pymavlink's own parser.

A `.tlog` is a row of records: 8 bytes big-endian, microseconds of the recorder's clock since 1970 (its two lowest
bits name the link), then one MAVLink packet. A raw `.mavlink` file is packets only.
"""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

from pipeline.telemetry.flight_log import LogFormat
from pipeline.telemetry.mapped_file import Bytes, mapped
from pipeline.telemetry.mavlink_names import WANTED, has_stamps
from pipeline.telemetry.tables import Column, MessageTable, Progress, RawLog

STAMP_BYTES = 8
A_DAY_S = 86_400.0


def read_mavlink_plain(path: Path, *, wanted: tuple[str, ...] = WANTED, progress: Progress = None) -> RawLog:
    """Every message of the `wanted` names in a `.tlog` or raw MAVLink file.

    Raises InputFileError where the file is missing or cannot be read.
    """
    data = mapped(path, expected="a MAVLink log")
    stamped = has_stamps(data, path)
    rows: dict[str, list[tuple[int, float, Any]]] = defaultdict(list)
    counts: Counter[str] = Counter()
    for place, record_s, message in _messages(data, stamped, progress):
        name = message.get_type()
        counts[name] += 1
        if name in wanted:
            rows[name].append((place, record_s, message))
    corrupt = counts.pop("BAD_DATA", 0)
    kind: LogFormat = "tlog" if stamped else "mavlink"
    return RawLog(
        path=path,
        format=kind,
        tables={name: _table(name, found) for name, found in rows.items()},
        counts=counts,
        corrupt_packets=corrupt,
    )


def _messages(data: Bytes, stamped: bool, progress: Progress) -> Iterator[tuple[int, float, Any]]:
    """Place, recorder's time and message, bad data included."""
    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    at, place, stamp_s, bad = 0, 0, float("nan"), False
    good_s = float("nan")
    while True:
        if stamped and len(data) - at >= STAMP_BYTES:
            stamp_s, at = _stamp(data, at, good_s if bad else float("nan"))
        message = None
        while message is None:
            chunk = data[at : at + parser.bytes_needed()]
            at += len(chunk)
            message = parser.parse_char(chunk)
            if message is None and not chunk:
                return
        bad = message.get_type() == "BAD_DATA"
        good_s = good_s if bad else stamp_s
        yield place, stamp_s, message
        place += 1
        if progress is not None and place % 4096 == 0:
            progress(at / len(data))


def _stamp(data: Bytes, at: int, expected_s: float) -> tuple[float, int]:
    """The recorder's time at `at` and the place after it; after bad data, the next one near `expected_s`."""
    while True:
        stamp_s = float(struct.unpack_from(">Q", data, at)[0]) * 1e-6
        if not abs(stamp_s - expected_s) > 3 * A_DAY_S or at + STAMP_BYTES >= len(data):
            return stamp_s, at + STAMP_BYTES
        at += 1


def _table(name: str, rows: list[tuple[int, float, Any]]) -> MessageTable:
    messages = [message for _, _, message in rows]
    return MessageTable(
        name=name,
        place=np.array([place for place, _, _ in rows], dtype=np.int64),
        record_time_s=np.array([record_s for _, record_s, _ in rows], dtype=float),
        system=np.array([m.get_srcSystem() for m in messages], dtype=np.int64),
        component=np.array([m.get_srcComponent() for m in messages], dtype=np.int64),
        columns={field: _column([getattr(m, field) for m in messages]) for field in messages[0].fieldnames},
    )


def _column(values: list[Any]) -> Column:
    return np.array(values)
