"""ArduPilot DataFlash logs: binary (.bin) and the text that tools make of them (.log).

The log defines its own messages (`dataflash_layout`); values are scaled by division, as ArduPilot's tools do.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Ints
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.telemetry.dataflash.messages.layout import CHUNK, DIVISOR, Layout, layouts_of
from pipeline.telemetry.dataflash.messages.places import judged, scan_dataflash
from pipeline.telemetry.log.byte_ranges import Pieces, bytes_in
from pipeline.telemetry.log.mapped_file import Bytes, mapped, taken
from pipeline.telemetry.log.tables import Column, MessageTable, Progress, RawLog

WANTED = (
    "PARM", "ATT", "XKQ", "XKQ1", "NKQ1", "AHR2", "POS", "GPS", "GPA", "MNT", "CAM", "TRIG", "XKF4", "NKF4", "XKF1",
    "NKF1", "ORGN",
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
    found = judged(np.frombuffer(data, np.uint8), layouts, found)
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
        tables={
            layouts[kind].name: _gather(data, layouts[kind], found.place[found.kind == kind])
            for kind in np.unique(found.kind).tolist()
        },
        counts={name: int(found.counts[kind]) for name, kind in names.items() if found.counts[kind]},
        corrupt_packets=found.corrupt,
        bytes_read=len(data) if pieces and searched else bytes_in(pieces or ()),
    )


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
        name: np.char.encode(text[:, i], "ascii", "replace") if letter in "nNZa" else _parsed(text[:, i])
        for i, (name, letter) in enumerate(zip(layout.fields, layout.letters, strict=False))
    }
    return _table(layout.name, np.array([place for place, _ in rows], dtype=np.int64), columns)


def _parsed(text: Column) -> Column:
    import pandas as pd  # slow to import, and binary logs need none

    return np.asarray(pd.to_numeric(pd.Series(text), errors="coerce").to_numpy(float))
