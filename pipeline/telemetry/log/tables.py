"""What a reader hands on: the wanted messages as columns, before anything is made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.telemetry.log.flight_log import LogFormat

Column = npt.NDArray[Any]
Progress = Callable[[float], None] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class MessageTable:
    """All messages of one name, in the order of the file.

    place          (n,) increasing with the place in the file
    record_time_s  (n,) the recorder's clock, POSIX seconds; NaN where the format has none
    system, component  (n,) who sent it, whole numbers up to 255; zero where the format has none
    columns        field -> (n,) or (n, k), exactly as the reader's source defines its values
    """

    name: str
    place: Ints
    record_time_s: Floats
    system: npt.NDArray[np.integer[Any]]
    component: npt.NDArray[np.integer[Any]]
    columns: Mapping[str, Column]

    def __len__(self) -> int:
        return len(self.place)

    def __contains__(self, field_name: str) -> bool:
        return field_name in self.columns

    def floats(self, field_name: str) -> Floats:
        """One field as float64 (n,); NaN throughout where this version of the message has no such field, or calls it
        text or an array."""
        column = self.columns.get(field_name)
        if column is None or column.dtype.kind == "S" or column.ndim > 1:
            return np.full(len(self), np.nan)
        with np.errstate(invalid="ignore"):  # a signalling NaN in a broken message is a NaN
            return np.asarray(column, float)

    def texts(self, field_name: str) -> tuple[str, ...]:
        """One field as ASCII text, a row each; empty where this version has no such field or calls it a number."""
        column = self.columns.get(field_name)
        if column is None or column.dtype.kind != "S":
            return ("",) * len(self)
        return tuple(value.decode("ascii", "replace") for value in column.tolist())

    def only(self, keep: Bools) -> MessageTable:
        """The rows where `keep` (n,) is true."""
        if keep.all():
            return self
        return MessageTable(
            name=self.name,
            place=self.place[keep],
            record_time_s=self.record_time_s[keep],
            system=self.system[keep],
            component=self.component[keep],
            columns={name: column[keep] for name, column in self.columns.items()},
        )


def joined_tables(parts: Sequence[MessageTable]) -> MessageTable:
    """One table of parts that follow each other; a field that one of them does not have is NaN, or empty, there."""
    if len(parts) == 1:
        return parts[0]
    names = dict.fromkeys(name for part in parts for name in part.columns)
    return MessageTable(
        name=parts[0].name,
        place=np.concatenate([part.place for part in parts]),
        record_time_s=np.concatenate([part.record_time_s for part in parts]),
        system=np.concatenate([part.system for part in parts]),
        component=np.concatenate([part.component for part in parts]),
        columns={name: _joined_column([part.columns.get(name) for part in parts], parts) for name in names},
    )


def _joined_column(columns: Sequence[Column | None], parts: Sequence[MessageTable]) -> Column:
    there = [column for column in columns if column is not None]
    kinds = {column.dtype.kind == "S" for column in there}
    if len({column.shape[1:] for column in there}) > 1 or len(kinds) > 1:  # the meaning changed: the last one holds
        there = there[-1:]
    empty: Column = np.zeros((), there[-1].dtype) if there[-1].dtype.kind == "S" else np.array(np.nan)
    return np.concatenate(
        [
            np.broadcast_to(empty, (len(part), *there[-1].shape[1:]))
            if column is None or not any(column is one for one in there)
            else column
            for column, part in zip(columns, parts, strict=True)
        ]
    )


class Growing:
    """One table out of pieces that come in the order of the file, with room for what is expected to come.

    Its arrays grow in place: pieces kept till the end, then joined, would take twice the memory.
    """

    def __init__(self, first: MessageTable) -> None:
        self._name, self._fields, self._rows = first.name, tuple(first.columns), len(first)
        self._arrays = [array if array.flags.owndata else array.copy() for array in _arrays(first)]

    def add(self, piece: MessageTable, share: float) -> None:
        """Appends `piece`, at the end of which the `share` of the file is read."""
        begin, self._rows = self._rows, self._rows + len(piece)
        room = len(self._arrays[0])
        if self._rows > room:
            room = max(self._rows, int(1.02 * self._rows / share))
        for array, part in zip(self._arrays, _arrays(piece), strict=True):
            _give_room(array, room)
            array[begin : self._rows] = part

    def whole(self) -> MessageTable:
        """The table; nothing can be added any more."""
        for array in self._arrays:
            _give_room(array, self._rows)
        place, record_time_s, system, component, *columns = self._arrays
        return MessageTable(
            name=self._name, place=place, record_time_s=record_time_s, system=system, component=component,
            columns=dict(zip(self._fields, columns, strict=True)),
        )  # fmt: skip


def _arrays(table: MessageTable) -> list[Column]:
    return [table.place, table.record_time_s, table.system, table.component, *table.columns.values()]


def _give_room(array: Column, rows: int) -> None:
    if len(array) != rows:
        array.resize((rows, *array.shape[1:]), refcheck=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """A log as its reader found it: tables by message name, and what could not be read.

    bytes_read  how many of the file's bytes were looked at, where it was read in pieces; else 0
    heads       places at which another log begins, of logs joined in one file, by definitions that are repeated
    """

    path: Path
    format: LogFormat
    tables: Mapping[str, MessageTable]
    counts: Mapping[str, int]
    corrupt_packets: int = 0
    notes: tuple[str, ...] = field(default=())
    bytes_read: int = 0
    heads: tuple[int, ...] = ()

    def without(self, names: Sequence[str]) -> RawLog:
        """The same without the messages of some names."""
        return replace(self, tables={name: table for name, table in self.tables.items() if name not in names})

    def table(self, name: str, keep: Callable[[MessageTable], Bools] | None = None) -> MessageTable | None:
        """The messages of one name (those that `keep` takes); None where there is none."""
        found = self.tables.get(name)
        if found is not None and keep is not None:
            found = found.only(keep(found))
        return found if found is not None and len(found) else None
