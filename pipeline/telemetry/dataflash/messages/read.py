"""ArduPilot DataFlash logs: binary (.bin) and the text that tools make of them (.log).

The log defines its own messages (`dataflash_layout`); values are scaled by division, as ArduPilot's tools do.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Ints
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.telemetry.dataflash.messages.layout import (
    CHUNK,
    DIVISOR,
    FMT_BYTES,
    FMT_KIND,
    Layout,
    is_damage,
    layout_of,
    layouts_of,
)
from pipeline.telemetry.dataflash.messages.places import Places, judged, scan_dataflash
from pipeline.telemetry.log.byte_ranges import Pieces, bytes_in
from pipeline.telemetry.log.mapped_file import Bytes, mapped, taken
from pipeline.telemetry.log.tables import Column, MessageTable, Progress, RawLog, joined_tables

MOST_EPOCHS = 64
"""Redefinitions that are followed: a log that redefines more often is broken."""
WANTED = (
    "PARM", "ATT", "XKQ", "XKQ1", "XKQ2", "NKQ", "NKQ1", "NKQ2", "AHR2", "POS", "GPS", "GPA", "GPS2", "GPA2", "GPSB",
    "GPAB", "MNT", "CAM", "TRIG", "XKF4", "NKF4", "XKF1", "XKF6", "NKF1", "NKF6", "ORGN", "SIM",
)  # fmt: skip


def read_dataflash(
    path: Path,
    *,
    wanted: tuple[str, ...] = WANTED,
    pieces: Pieces | None = None,
    complete: bool = True,
    progress: Progress = None,
) -> RawLog:
    """The `wanted` messages of a binary DataFlash log, or of `pieces` of it.

    Definitions are looked for at the file's start and, unless `complete` is false, in all of it where something is not
    understood. Raises InputFileError where the file cannot be read or defines no message.
    """
    data = mapped(path, expected="an ArduPilot DataFlash log")
    parts = pieces or ((0, len(data)),)
    layouts = layouts_of(data, upto=CHUNK)  # ArduPilot defines everything at the start, and whole logs end here
    found = scan_dataflash(data, layouts, wanted, parts, progress)
    searched = complete and found.corrupt > found.cut  # something was not understood that is not just cut off
    if searched and (every := layouts_of(data, upto=len(data))) != layouts:
        layouts = every
        found = scan_dataflash(data, layouts, wanted, parts, progress)
    if not layouts:
        raise InputFileError(
            where=str(path),
            seen="no message definition (FMT)",
            expected="an ArduPilot DataFlash log",
            advice="check that the file was downloaded whole and as binary",
        )
    source = np.frombuffer(data, np.uint8)
    tables: dict[str, list[MessageTable]] = defaultdict(list)
    counts: Counter[str] = Counter()
    corrupt = 0
    for layouts_then, found_then in _epochs(data, layouts, found, wanted, parts):
        believed = judged(source, layouts_then, found_then)
        corrupt += believed.corrupt
        for kind in np.flatnonzero(believed.counts).tolist():
            counts[layouts_then[kind].name] += int(believed.counts[kind])
        for kind in np.flatnonzero(np.bincount(believed.kind)).tolist():
            if layouts_then[kind].name in wanted:
                table = _gather(data, layouts_then[kind], believed.place[believed.kind == kind])
                tables[layouts_then[kind].name].append(table)
    unreadable = sorted(layout.name for layout in layouts.values() if not layout.readable and counts[layout.name])
    return RawLog(
        path=path,
        format="dataflash",
        tables={name: joined_tables(parts_) for name, parts_ in tables.items()},
        counts=counts,
        corrupt_packets=corrupt,
        notes=(f"{', '.join(unreadable)}: definition contradicts itself, its messages are stepped over",)
        if unreadable
        else (),
        bytes_read=len(data) if pieces and searched else bytes_in(pieces or ()),
        heads=_heads(data, found),
    )


def _heads(data: Bytes, found: Places) -> tuple[int, ...]:
    """Where logs begin but the first: ArduPilot defines the definition itself first of all."""
    own = [at for at in found.place[found.kind == FMT_KIND].tolist() if data[at + 3] == FMT_KIND]
    return tuple(own[1:])


def _epochs(
    data: Bytes, layouts: Mapping[int, Layout], found: Places, wanted: tuple[str, ...], parts: Pieces
) -> Iterator[tuple[Mapping[int, Layout], Places]]:
    """The messages under the definitions that hold for them, from each redefinition on anew."""
    for _ in range(MOST_EPOCHS):
        redefined = _redefined(data, layouts, found)
        if redefined is None:
            break
        at, layout = redefined
        before = tuple((begin, min(end, at)) for begin, end in parts if begin < at)
        yield layouts, scan_dataflash(data, layouts, wanted, before, None)
        layouts = {**layouts, layout.kind: layout}
        parts = tuple((max(begin, at), end) for begin, end in parts if end > at)
        if not parts:
            return
        found = scan_dataflash(data, layouts, wanted, parts, None)
    yield layouts, found


def _redefined(data: Bytes, layouts: Mapping[int, Layout], found: Places) -> tuple[int, Layout] | None:
    """Where the first definition ends that is another than the one in force, and what it says."""
    for at in found.place[found.kind == FMT_KIND].tolist():
        message = bytes(data[at : at + FMT_BYTES])
        layout = layout_of(data, message)
        known = None if layout is None else layouts.get(layout.kind)
        if layout is None or known is None or layout == known or not layout.readable:
            continue
        first = data.find(bytes([*message[:4]]))
        if first < 0 or first == at or not is_damage(bytes(data[first : first + FMT_BYTES]), message):
            return at + FMT_BYTES, layout
    return None


def _gather(data: Bytes, layout: Layout, start: Ints) -> MessageTable:
    message = taken(np.frombuffer(data, np.uint8), start, layout.length).view(layout.dtype)
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
    rows: dict[tuple[str, Layout], list[tuple[int, list[str]]]] = defaultdict(list)
    counts: Counter[str] = Counter()
    corrupt = 0
    heads: list[int] = []
    for place, line in enumerate(lines):
        name, *values = (part.strip() for part in line.split(","))
        if name == "FMT" and len(values) >= 5 and values[0].isdigit():
            heads += [place] if values[2] == "FMT" else []
            layouts[values[2]] = _text_layout(values)
        elif name in layouts and len(values) == len(layouts[name].fields):
            counts[name] += 1
            if name in wanted:
                rows[name, layouts[name]].append((place, values))
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
    tables: dict[str, list[MessageTable]] = defaultdict(list)
    for (name, layout), found in rows.items():
        tables[name].append(_text_table(layout, found))
    return RawLog(
        path=path,
        format="dataflash text",
        tables={name: joined_tables(parts) for name, parts in tables.items()},
        counts=counts,
        corrupt_packets=corrupt,
        heads=tuple(heads[1:]),
    )


def _text_layout(values: list[str]) -> Layout:
    return Layout(kind=int(values[0]), name=values[2], length=0, letters=values[3], fields=tuple(values[4:]))


def _text_table(layout: Layout, rows: list[tuple[int, list[str]]]) -> MessageTable:
    text = np.array([values for _, values in rows])
    columns = {
        name: np.char.encode(text[:, i], "ascii", "replace") if letter in "nNZa" else _parsed(text[:, i])
        for i, (name, letter) in enumerate(zip(layout.fields, layout.letters, strict=False))
    }
    return _table(layout.name, np.array([place for place, _ in rows], dtype=np.int64), columns)


def _parsed(text: Column) -> Column:
    import pandas as pd  # slow to import, and binary logs need none

    return np.asarray(pd.to_numeric(pd.Series(text), errors="coerce").to_numpy(float))
