"""ArduPilot DataFlash logs: binary (.bin) and the text that tools make of them (.log).

The log defines its own messages: FMT (kind 128) names kind, length, name, a letter per field and the fields' names.
Letters c, C, e, E are hundredths and L is 1e-7 degrees; values are scaled by division, as ArduPilot's tools do.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from calibration.arrays import Ints
from calibration.files import read_bytes
from pipeline.errors import InputFileError
from pipeline.telemetry.compiled import COMPILED
from pipeline.telemetry.mapped_file import Bytes, mapped
from pipeline.telemetry.tables import Column, MessageTable, Progress, RawLog

WANTED = ("PARM", "ATT", "XKQ", "XKQ1", "NKQ1", "AHR2", "POS", "GPS", "GPA", "MNT", "CAM", "TRIG", "XKF4", "NKF4")
LETTERS = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "g": "<f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "d": "<f8",
    "M": "i1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
DIVISOR = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
FMT_KIND, FMT_BYTES, FMT_HEAD = 128, 89, b"\xa3\x95\x80"
CHUNK = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How one kind of message is laid out."""

    kind: int
    name: str
    length: int
    letters: str
    fields: tuple[str, ...]

    @property
    def members(self) -> list[tuple[str, str]]:
        """Fields and their letters."""
        return list(zip(self.fields, self.letters, strict=True))

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The whole message, header included."""
        return np.dtype([("head", "S3"), *((name, LETTERS[letter]) for name, letter in self.members)])

    @property
    def time_bytes(self) -> int:
        """8 where the message starts with microseconds since boot, 4 with milliseconds, else 0."""
        first = (self.fields[0], self.letters[0]) if self.fields else ("", "")
        return {("TimeUS", "Q"): 8, ("TimeMS", "I"): 4}.get(first, 0)


def read_dataflash(path: Path, *, wanted: tuple[str, ...] = WANTED, progress: Progress = None) -> RawLog:
    """The `wanted` messages of a binary DataFlash log.

    Raises InputFileError where the file cannot be read or defines no message.
    """
    data = mapped(path, expected="an ArduPilot DataFlash log")
    layouts = layouts_of(data, upto=CHUNK)  # ArduPilot defines everything at the start, and whole logs end here
    starts, counts, corrupt = _scan(data, layouts, wanted, progress)
    if corrupt:
        layouts = layouts_of(data, upto=len(data))
        starts, counts, corrupt = _scan(data, layouts, wanted, progress)
    if not layouts:
        raise InputFileError(
            where=str(path),
            seen="no message definition (FMT)",
            expected="an ArduPilot DataFlash log",
            advice="check that the file was downloaded whole and as binary",
        )
    names = {layout.name: kind for kind, layout in layouts.items()}
    return RawLog(
        path=path,
        format="dataflash",
        tables={layouts[kind].name: _gather(data, layouts[kind], where) for kind, where in starts.items()},
        counts={name: int(counts[kind]) for name, kind in names.items() if counts[kind]},
        corrupt_packets=corrupt,
    )


def layouts_of(data: Bytes, *, upto: int) -> dict[int, Layout]:
    """Every kind that the first `upto` bytes define consistently; the first definition holds."""
    found: dict[int, Layout] = {}
    for begin in range(0, min(upto, len(data)), CHUNK):
        part = data[begin : begin + CHUNK + FMT_BYTES - 1]
        at = part.find(FMT_HEAD, 0, CHUNK + 2)
        while at >= 0:
            layout = _layout(part[at : at + FMT_BYTES])
            if layout is not None:
                found.setdefault(layout.kind, layout)
            at = part.find(FMT_HEAD, at + 3, CHUNK + 2)
    return found


def _layout(message: bytes) -> Layout | None:
    """What one FMT defines; None where it contradicts itself (a broken one)."""
    if len(message) < FMT_BYTES:
        return None
    kind, length = message[3], message[4]
    try:
        name, letters, fields = (
            part.rstrip(b"\0").decode("ascii") for part in (message[5:9], message[9:25], message[25:89])
        )
        layout = Layout(kind=kind, name=name, length=length, letters=letters, fields=tuple(fields.split(",")))
        named = name.isalnum() and all(layout.fields)
        return layout if named and layout.dtype.itemsize == length else None
    except (UnicodeDecodeError, KeyError, ValueError):
        return None


def _scan(
    data: Bytes, layouts: Mapping[int, Layout], wanted: tuple[str, ...], progress: Progress
) -> tuple[dict[int, Ints], Ints, int]:
    """Places of the wanted messages by kind, counts by kind, and how many stretches were no message."""
    from pipeline.telemetry.dataflash_scan import AT, CORRUPT, scan_messages  # here, for numba is slow to import

    length, time_bytes, counts = np.zeros((3, 256), dtype=np.int64)
    listed = np.zeros(256, dtype=np.bool_)
    for kind, layout in layouts.items():
        length[kind], time_bytes[kind], listed[kind] = layout.length, layout.time_bytes, layout.name in wanted
    start, kinds = np.empty((2, CHUNK), dtype=np.int64)
    state = np.array([0, 0, -1], dtype=np.int64)
    source = np.frombuffer(data, np.uint8) if COMPILED else bytes(data)
    parts: dict[int, list[Ints]] = {}
    while state[AT] + 3 <= len(data):
        n = scan_messages(source, len(data), length, time_bytes, listed, counts, start, kinds, state)
        for kind in np.unique(kinds[:n]).tolist():
            parts.setdefault(kind, []).append(start[:n][kinds[:n] == kind])
        if progress is not None:
            progress(float(state[AT]) / len(data))
    corrupt = int(state[CORRUPT]) + int(0 < len(data) - state[AT] < 3)
    return {kind: np.concatenate(found) for kind, found in parts.items()}, counts, corrupt


def _gather(data: Bytes, layout: Layout, start: Ints) -> MessageTable:
    rows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), layout.length)[start]
    message = rows.view(layout.dtype)[:, 0]
    return _table(layout.name, start, {f: _scaled(message[f], c) for f, c in layout.members})


def _table(name: str, place: Ints, columns: Mapping[str, Column]) -> MessageTable:
    zero = np.zeros(len(place), dtype=np.int64)
    nothing = np.full(len(place), np.nan)
    return MessageTable(name=name, place=place, record_time_s=nothing, system=zero, component=zero, columns=columns)


def _scaled(value: Column, letter: str) -> Column:
    return value / DIVISOR[letter] if letter in DIVISOR else np.ascontiguousarray(value)


def read_dataflash_text(path: Path, *, wanted: tuple[str, ...] = WANTED, progress: Progress = None) -> RawLog:
    """The `wanted` messages of a DataFlash log as text: "NAME, value, value, ..." under "FMT, ..." lines.

    Raises InputFileError where the file cannot be read or defines no message.
    """
    lines = read_bytes(path, expected="an ArduPilot DataFlash log as text").decode("utf-8", "replace").splitlines()
    layouts: dict[str, Layout] = {}
    rows: dict[str, list[tuple[int, list[str]]]] = defaultdict(list)
    counts: Counter[str] = Counter()
    corrupt = 0
    for place, line in enumerate(lines):
        name, *values = (part.strip() for part in line.split(","))
        if name == "FMT" and len(values) >= 5 and values[0].isdigit():
            layouts.setdefault(values[2], _text_layout(values))
        elif name in layouts and len(values) == len(layouts[name].fields):
            counts[name] += 1
            if name in wanted:
                rows[name].append((place, values))
        elif name and name not in ("FMT", "MSG"):
            corrupt += 1
        if progress is not None and place % 65536 == 0:
            progress(place / len(lines))
    if not layouts:
        raise InputFileError(
            where=str(path),
            seen="no FMT line",
            expected="an ArduPilot DataFlash log as text",
            advice="give the binary log (.bin) it was made from",
        )
    return RawLog(
        path=path,
        format="dataflash text",
        tables={name: _text_table(layouts[name], found) for name, found in rows.items()},
        counts=counts,
        corrupt_packets=corrupt,
    )


def _text_layout(values: list[str]) -> Layout:
    return Layout(kind=int(values[0]), name=values[2], length=0, letters=values[3], fields=tuple(values[4:]))


def _text_table(layout: Layout, rows: list[tuple[int, list[str]]]) -> MessageTable:
    text = np.array([values for _, values in rows])
    columns = {
        name: text[:, i].astype("S") if letter in "nNZa" else _parsed(text[:, i])
        for i, (name, letter) in enumerate(zip(layout.fields, layout.letters, strict=False))
    }
    return _table(layout.name, np.array([place for place, _ in rows], dtype=np.int64), columns)


def _parsed(text: Column) -> Column:
    return np.asarray(pd.to_numeric(pd.Series(text), errors="coerce").to_numpy(float))
