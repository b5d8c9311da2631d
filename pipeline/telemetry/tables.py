"""What a reader hands on: the wanted messages as columns, before anything is made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.arrays import Bools, Floats, Ints
from pipeline.telemetry.flight_log import LogFormat

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
        """One field as float64; NaN throughout where this version of the message has no such field."""
        if field_name not in self.columns:
            return np.full(len(self), np.nan)
        with np.errstate(invalid="ignore"):  # a signalling NaN in a broken message is a NaN
            return np.asarray(self.columns[field_name], float)

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


def joined(pieces: list[MessageTable]) -> MessageTable:
    """Pieces of one table as one; the list is emptied, so that both are never whole at once."""
    first = pieces[0]
    if len(pieces) == 1:
        return pieces.pop()
    columns = [dict(piece.columns) for piece in pieces]
    whole = {name: np.concatenate([one.pop(name) for one in columns]) for name in first.columns}
    parts = {
        name: np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("place", "record_time_s", "system", "component")
    }
    pieces.clear()
    return MessageTable(name=first.name, columns=whole, **parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """A log as its reader found it: tables by message name, and what could not be read."""

    path: Path
    format: LogFormat
    tables: Mapping[str, MessageTable]
    counts: Mapping[str, int]
    corrupt_packets: int = 0
    notes: tuple[str, ...] = field(default=())

    def table(self, name: str, keep: Callable[[MessageTable], Bools] | None = None) -> MessageTable | None:
        """The messages of one name (those that `keep` takes); None where there is none."""
        found = self.tables.get(name)
        if found is not None and keep is not None:
            found = found.only(keep(found))
        return found if found is not None and len(found) else None
