#!/usr/bin/env python
"""Real logs by our readers and by pymavlink's and pyulog's: every message, every value; then with broken definitions.

python -m scripts.validation.check_log_readers ../shared/real/logs

A message of theirs counts as found by us where ours stands at the same bytes; values are compared field by field. A
definition (FMT of DataFlash; format and subscription of ULog) is broken by one flipped bit, or taken out; of what is
left the messages of the whole log count that a reader still finds where they stand.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
from pymavlink import DFReader, mavutil

from calibration.foundation.errors import InputFileError
from pipeline.telemetry.dataflash.messages.layout import Layout, layouts_of
from pipeline.telemetry.dataflash.messages.read import read_dataflash
from pipeline.telemetry.log.tables import MessageTable
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from pipeline.telemetry.ulog.topics import load_topics
from scripts.validation.check_log_corruption import silence, tlog_names
from scripts.validation.figures import tell

DEFINITION, DEFINITION_BYTES = b"\xa3\x95\x80", 89
SEED = 20


@dataclass(kw_only=True)
class Tally:
    """Messages and values of one log: theirs, ours, theirs that we lack, values compared, and those that differ."""

    theirs: int = 0
    ours: int = 0
    lacking: int = 0
    compared: int = 0
    differ: int = 0


def compare(tally: Tally, mine: dict[str, Any], row: int, its: dict[str, Any]) -> None:
    """One message field by field; a field that we do not have differs."""
    for name, value in its.items():
        tally.compared += 1
        if name not in mine:
            tally.differ += 1
            continue
        own = mine[name][row]
        if isinstance(value, str | bytes):
            text = value if isinstance(value, bytes) else value.encode("utf-8", "replace")
            same = bytes(own).split(b"\0")[0].decode("utf-8", "replace") == text.split(b"\0")[0].decode(
                "utf-8", "replace"
            ) or bytes(own).split(b"\0")[0] == value.split("\0")[0].encode("ISO-8859-1", "replace")
        else:
            a, b = np.asarray(own), np.asarray(list(value) if hasattr(value, "__len__") else value)
            same = bool(np.all((a == b) | ((a != a) & (b != b))))
        tally.differ += not same


def rows_by_place(tables: dict[str, MessageTable]) -> dict[str, dict[int, int]]:
    """Message name -> its place in the file -> its row."""
    return {name: {int(place): row for row, place in enumerate(table.place)} for name, table in tables.items()}


# --- MAVLink --------------------------------------------------------------------------------------------------------


def check_tlog(path: Path) -> Tally:
    """Every packet of a known message that pymavlink's log reader finds, in its order."""
    ours = read_mavlink_fast(path, wanted=tlog_names())
    theirs: dict[str, list[Any]] = {}
    link = mavutil.mavlink_connection(str(path), robust_parsing=True)
    while (message := link.recv_msg()) is not None:
        if message.get_type() in ours.tables or message.get_type() in tlog_names():
            theirs.setdefault(message.get_type(), []).append(message)
    tally = Tally(theirs=sum(map(len, theirs.values())), ours=sum(ours.counts.values()))
    for name, found in theirs.items():
        table = ours.tables.get(name)
        rows = [None] * len(found) if table is None else aligned(table, found)
        for row, message in zip(rows, found, strict=True):
            if row is None or table is None:
                tally.lacking += 1
            else:
                compare(tally, dict(table.columns), row, fields_of(message))
    return tally


def fields_of(message: Any) -> dict[str, Any]:
    """Its values by name."""
    return {field: getattr(message, field) for field in message.get_fieldnames()}


def aligned(table: MessageTable, found: list[Any]) -> list[int | None]:
    """Our row of each of their messages: one by one where there are as many, else the next one that is the same."""
    if len(table) == len(found):
        return list(range(len(found)))
    rows: list[int | None] = []
    at, columns = 0, dict(table.columns)
    for message in found:
        row = next((i for i in range(at, len(table)) if same_message(columns, i, message)), None)
        rows.append(row)
        at = at if row is None else row + 1
    return rows


def same_message(columns: dict[str, Any], row: int, message: Any) -> bool:
    """Whether all values of a row are a message's."""
    tally = Tally()
    compare(tally, columns, row, fields_of(message))
    return tally.differ == 0


# --- DataFlash ------------------------------------------------------------------------------------------------------


def dfreader_messages(path: Path) -> list[tuple[int, Any]]:
    """Every message that DFReader finds with its place, until it gives up."""
    found = []
    try:
        with silence():
            reader = DFReader.DFReader_binary(str(path))
            reader.rewind()
            while (message := reader.recv_msg()) is not None:
                found.append((reader.offset - message.fmt.len, message))
    except Exception as error:  # whatever it trips over
        print(f"    DFReader gives up: {error!r}"[:120])
    return found


def check_dataflash(path: Path) -> Tally:
    """Every message that DFReader finds."""
    theirs = dfreader_messages(path)
    ours = read_dataflash(path, wanted=tuple({m.get_type() for _, m in theirs}))
    tally = Tally(theirs=len(theirs), ours=sum(ours.counts.values()))
    places = rows_by_place(dict(ours.tables))
    for place, message in theirs:
        row = places.get(message.get_type(), {}).get(place)
        if row is None:
            tally.lacking += 1
            continue
        compare(tally, dict(ours.tables[message.get_type()].columns), row, fields_of(message))
    return tally


Keys = set[tuple[int, str]]
"""Place and name of each message."""


@dataclass(frozen=True, kw_only=True)
class Whole:
    """The whole log: our tables, each value the same as DFReader's, as `check_dataflash` has told; and its layouts."""

    tables: Mapping[str, MessageTable]
    rows: Mapping[str, Mapping[int, int]]
    kinds: Mapping[int, Layout]

    @property
    def keys(self) -> Keys:
        """Every message."""
        return {(place, name) for name, places in self.rows.items() for place in places}


def our_tables(path: Path, names: set[str]) -> Mapping[str, MessageTable]:
    """What our reader finds; nothing where it refuses."""
    try:
        return read_dataflash(path, wanted=tuple(names)).tables
    except InputFileError:
        return {}


def ours_good(tables: Mapping[str, MessageTable], true: Whole) -> Keys:
    """Our true messages: those with most of the true fields, and true values in all of these."""
    found: Keys = set()
    for name, table in tables.items():
        its = true.tables.get(name)
        if its is None:
            continue
        mine, theirs = (np.asarray(part) for part in np.intersect1d(table.place, its.place, return_indices=True)[1:])
        common = table.columns.keys() & its.columns.keys()
        if not len(mine) or 2 * len(common) < len(its.columns):
            continue
        same = np.ones(len(mine), dtype=np.bool_)
        for field in common:
            same &= same_column(table.columns[field][mine], its.columns[field][theirs])
        found |= {(int(place), name) for place in table.place[mine[same]]}
    return found


def same_column(one: Any, other: Any) -> Any:
    """Which rows of two columns are one."""
    if one.dtype == other.dtype and one.shape == other.shape and one.dtype.kind != "S":
        same = (one == other) | ((one != one) & (other != other))
        return same if same.ndim == 1 else same.reshape(len(same), -1).all(axis=1)
    return np.array([same_value(a, b) for a, b in zip(one.tolist(), other.tolist(), strict=True)], dtype=np.bool_)


def theirs_good(found: list[tuple[int, Any]], true: Whole) -> Keys:
    """DFReader's true messages, told in the same way.

    What it makes of the same bytes by the same definition are the same values: only others are held against ours.
    """
    good: Keys = set()
    as_before: dict[int, bool] = {}
    for place, message in found:
        name = message.get_type()
        row = true.rows.get(name, {}).get(place)
        if row is None:
            continue
        fmt = message.fmt
        if id(fmt) not in as_before:
            known = true.kinds.get(fmt.type)
            as_before[id(fmt)] = known is not None and (known.name, known.length, known.letters, known.fields) == (
                fmt.name, fmt.len, fmt.format, tuple(fmt.columns)
            )  # fmt: skip
        if as_before[id(fmt)] or bears_out(fields_of(message), true.tables[name], row):
            good.add((place, name))
    return good


def bears_out(its: dict[str, Any], true: MessageTable, row: int) -> bool:
    """Whether values under true names are true."""
    common = its.keys() & true.columns.keys()
    return 2 * len(common) >= len(true.columns) and all(
        same_value(its[name], true.columns[name][row]) for name in common
    )


def same_value(one: Any, other: Any) -> bool:
    """Whether two values are one; texts up to their first zero, no number being no number."""
    if isinstance(one, str | bytes) and isinstance(other, str | bytes):
        return bool(text_of(one) == text_of(other))
    a, b = np.asarray(one), np.asarray(other)
    return bool(a.shape == b.shape and np.all((a == b) | ((a != a) & (b != b))))


def text_of(value: str | bytes) -> str:
    """As DFReader tells it."""
    if isinstance(value, str):
        return value.split("\0")[0]
    try:
        return value.decode("utf-8").split("\0")[0]
    except UnicodeDecodeError:
        return value.decode("ISO-8859-1").split("\0")[0]


def defines(whole: bytes, at: int, kinds: Mapping[int, Layout]) -> bool:
    """Whether the definition of a known kind stands at a place."""
    return whole[at + 3] in kinds and whole[at + 5 : at + 9].rstrip(b"\0") == kinds[whole[at + 3]].name.encode()


def broken_dataflash(whole: bytes, rng: np.random.Generator) -> tuple[bytes, int]:
    """The log with one of its definitions flipped in a bit, or overwritten by zeros; and where that stands."""
    kinds = layouts_of(whole, upto=len(whole))
    heads = (found.start() for found in re.finditer(re.escape(DEFINITION), whole[:-DEFINITION_BYTES]))
    places = [at for at in heads if whole[at + 3] != DEFINITION[2] and defines(whole, at, kinds)]
    place, data = int(rng.choice(places)), bytearray(whole)
    if rng.random() < 0.25:
        data[place : place + DEFINITION_BYTES] = bytes(DEFINITION_BYTES)
    else:
        data[place + int(rng.integers(3, DEFINITION_BYTES))] ^= 1 << int(rng.integers(8))
    return bytes(data), place


def check_broken_dataflash(path: Path, folder: Path, runs: int) -> Counter[str]:
    """Good messages of both readers over `runs` broken definitions, and in how many ours finds fewer, or wrong ones."""
    whole, tally = path.read_bytes(), Counter[str]()
    kinds = layouts_of(whole, upto=len(whole))
    names = {layout.name for layout in kinds.values()}
    tables = our_tables(path, names)
    true = Whole(tables=tables, rows=rows_by_place(dict(tables)), kinds=kinds)
    every = true.keys
    for run in range(runs):
        content, place = broken_dataflash(whole, np.random.default_rng([run, SEED]))
        broken = folder / "broken.bin"
        broken.write_bytes(content)
        rest = every - {(place, "FMT")}  # that one says something else
        changed = {layout.name for layout in layouts_of(content, upto=len(content)).values()}
        ours, theirs = our_tables(broken, names | changed), dfreader_messages(broken)
        mine, its = ours_good(ours, true) & rest, theirs_good(theirs, true) & rest
        own = {(int(at), name) for name, table in ours.items() for at in table.place} & rest
        fewer = its - mine if len(mine) < len(its) else set()
        tally += Counter({"runs": 1, "ours": len(mine), "theirs": len(its), "fewer": int(bool(fewer)),
                          "ours wrong": len(own) - len(mine),
                          "theirs wrong": len({(at, m.get_type()) for at, m in theirs} & rest) - len(its)})  # fmt: skip
        if fewer:
            print(f"    run {run}: {len(mine)} of ours, {len(its)} of DFReader's; lacking {sorted(fewer)[:3]}")
    return tally


# --- ULog -----------------------------------------------------------------------------------------------------------


def pyulog_topics(path: Path) -> dict[tuple[str, int], dict[str, Any]] | None:
    """What pyulog finds by topic and instance, those with times; None where it gives up."""
    import pyulog

    try:
        with redirect_stdout(io.StringIO()):
            log = pyulog.ULog(str(path))
    except Exception:  # whatever it trips over
        return None
    return {(d.name, d.multi_id): d.data for d in log.data_list if "timestamp" in d.data}


def check_ulog(path: Path) -> Tally | None:
    """Every value of every topic; None where pyulog gives up."""
    theirs = pyulog_topics(path)
    if theirs is None:
        return None
    ours, tally = load_topics(path).instances, Tally()
    for (name, number), its in theirs.items():
        many = len(its["timestamp"])
        tally.theirs += many
        mine = ours.get(name, {}).get(number)
        if mine is None or len(mine["timestamp"]) < many:
            tally.lacking += many - (0 if mine is None else len(mine["timestamp"]))
            continue
        tally.ours += len(mine["timestamp"])
        for field, column in its.items():
            a, b = np.asarray(mine[field]), np.asarray(column)
            tally.compared += a.size
            tally.differ += int((~((a == b) | ((a != a) & (b != b)))).sum()) if len(a) == len(b) else a.size
    return tally


def broken_ulog(whole: bytes, rng: np.random.Generator) -> bytes:
    """The log with one format (F) or subscription (A) flipped in a bit, or taken out."""
    places, at = [], 16
    while at + 3 <= len(whole):
        size, kind = int.from_bytes(whole[at : at + 2], "little"), whole[at + 2 : at + 3]
        if kind in (b"F", b"A"):
            places.append((at, 3 + size))
        at += 3 + size
    at, size = places[int(rng.integers(len(places)))]
    if rng.random() < 0.25:
        return whole[:at] + whole[at + size :]
    data = bytearray(whole)
    data[at + int(rng.integers(3, size))] ^= 1 << int(rng.integers(8))
    return bytes(data)


def check_broken_ulog(path: Path, folder: Path, runs: int) -> Counter[str]:
    """Messages of both readers over `runs` broken definitions, and in how many ours finds fewer or other ones."""
    whole, tally = path.read_bytes(), Counter[str]()
    for run in range(runs):
        broken = folder / "broken.ulg"
        broken.write_bytes(broken_ulog(whole, np.random.default_rng([run, SEED])))
        tally["runs"] += 1
        found = check_ulog(broken)
        if found is None:
            tally["refused by both"] += 1
            try:
                load_topics(broken)
                tally["read by ours alone"] += 1
            except InputFileError:
                pass
            continue
        tally += Counter({"ours": found.ours, "theirs": found.theirs, "fewer": int(found.lacking > 0),
                          "differ": found.differ})  # fmt: skip
    return tally


# --- all ------------------------------------------------------------------------------------------------------------


def check(path: Path, folder: Path, runs: int) -> bool:
    """One log, whole and with broken definitions."""
    kind = path.suffix.lower()
    whole = {".bin": check_dataflash, ".ulg": check_ulog}.get(kind, check_tlog)(path)
    if whole is None:
        print(f"{path.name:<52} pyulog gives up")
        return True
    print(f"{path.name:<52}{whole.theirs:>9}{whole.ours:>9}{whole.lacking:>9}{whole.compared:>12}{whole.differ:>9}")
    figures: dict[str, Any] = dict(vars(whole))
    fine = not (whole.lacking or whole.differ)
    breaks = {".bin": check_broken_dataflash, ".ulg": check_broken_ulog}.get(kind)
    if breaks is not None:
        broken = breaks(path, folder, runs)
        print("    broken definitions: " + ", ".join(f"{name} {many}" for name, many in sorted(broken.items())))
        figures["broken definitions"] = dict(broken)
        fine &= not (broken["fewer"] or broken["differ"])
    tell({path.name: figures})
    return fine


def main() -> int:
    """Every log of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="a folder of logs: .tlog, .mavlink, .bin, .ulg")
    parser.add_argument("--runs", type=int, default=20, help="broken definitions of each log (default 20)")
    given = parser.parse_args()
    paths = [p for p in sorted(given.folder.iterdir()) if p.suffix.lower() in (".tlog", ".mavlink", ".bin", ".ulg")]
    print(f"{'log':<52}{'theirs':>9}{'ours':>9}{'lacking':>9}{'values':>12}{'differ':>9}")
    with tempfile.TemporaryDirectory() as scratch:
        fine = min([check(path, Path(scratch), given.runs) for path in paths], default=False)  # every one is checked
    print("fine" if fine and paths else "NOT fine")
    return 0 if fine and paths else 1


if __name__ == "__main__":
    sys.exit(main())
