"""Comma-separated files read with care: every mistake names file, line and column.

Lines count as editors count them, the header being line 1.
"""

from __future__ import annotations

import csv
import difflib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from calibration.foundation.arrays import Bools, Floats, Ints
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes

LARGEST_FRAME = 2**31


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvTable:
    """The cells of one file as text, by column; `line[i]` is the line of row i in the file."""

    path: Path
    columns: dict[str, tuple[str, ...]]
    line: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.line)

    def wrong(self, row: int, column: str, *, expected: str, advice: str, seen: str | None = None) -> NoReturn:
        """Raise InputFileError about one cell; `seen` in words where the cell alone does not say it."""
        cell = self.columns[column][row]
        said = "an empty cell" if not cell.strip() else repr(cell)
        where = f"{self.path}, line {self.line[row]}, column {column}"
        raise InputFileError(where=where, seen=seen or said, expected=expected, advice=advice)

    def texts(self, column: str) -> npt.NDArray[np.str_]:
        """(n,) names, spaces around them gone; an empty one is an error."""
        names = np.array([cell.strip() for cell in self.columns[column]], dtype=np.str_)
        for row in np.flatnonzero(names == "")[:1]:
            self.wrong(row, column, expected="a name", advice="fill the cell or delete the row")
        return names

    def floats(self, column: str, *, advice: str, may_be_empty: bool = False) -> Floats:
        """(n,) finite numbers; NaN for an empty cell where that is allowed."""
        cells = self.columns[column]
        try:
            values = np.array(list(map(float, cells)))
        except ValueError:
            values = np.array([_number_or_nan(cell) for cell in cells])
        bad = ~np.isfinite(values)
        if may_be_empty:
            bad &= np.array([bool(cell.strip()) for cell in cells], dtype=bool)
        for row in np.flatnonzero(bad)[:1]:
            self.wrong(row, column, expected="a finite number", advice=advice)
        return values

    def frames(self, column: str = "frame") -> Ints:
        """(n,) frame numbers: whole, from 0; 12.0 is 12."""
        advice = "frames are whole numbers and count from 0"
        values = self.floats(column, advice=advice)
        bad = (values < 0) | (values != np.floor(values)) | (values >= LARGEST_FRAME)
        for row in np.flatnonzero(bad)[:1]:
            self.wrong(row, column, expected="a whole number from 0", advice=advice)
        return values.astype(np.int64)

    def rows(self, keep: Bools) -> CsvTable:
        """The rows where `keep` (n,) is true."""
        chosen = np.flatnonzero(keep).tolist()
        columns = {name: tuple(cells[i] for i in chosen) for name, cells in self.columns.items()}
        return CsvTable(path=self.path, columns=columns, line=tuple(self.line[i] for i in chosen))


def read_table(path: Path, *, needed: Sequence[str], optional: Sequence[str] = (), what: str) -> CsvTable:
    """The table in `path`, which must have the `needed` columns; others are kept as they are.

    `what` says in words what kind of file it should be. A column that looks like a misspelt, absent one is an error.

    Raises InputFileError: missing, empty, not UTF-8, no rows, a missing or doubled column, a row of another length.
    """
    expected = f"{what} with the columns {', '.join(needed)}" + "".join(f"[, {name}]" for name in optional)
    lines, header, rows = _parse(path, _decode(path, expected), expected)
    _check_header(path, header, needed, optional, expected)
    for line, row in zip(lines, rows, strict=True):
        if len(row) != len(header):
            raise InputFileError(
                where=f"{path}, line {line}",
                seen=f"{len(row)} cells",
                expected=f"{len(header)}, one for each column of the header",
                advice="look for a missing or an extra comma, or a file that was cut off",
            )
    cells = zip(*rows, strict=True) if rows else ((),) * len(header)
    return CsvTable(path=path, columns=dict(zip(header, cells, strict=True)), line=tuple(lines))


def _number_or_nan(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _decode(path: Path, expected: str) -> str:
    raw = read_bytes(path, expected=expected)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise InputFileError(
            where=f"{path}, line {line}",
            seen=f"a byte that is not UTF-8 (0x{raw[error.start]:02x})",
            expected=expected,
            advice="save the table as comma-separated text in UTF-8",
        ) from None
    if not text.strip():
        raise InputFileError(
            where=str(path), seen="an empty file", expected=expected, advice="write the table again, or check its name"
        )
    return text


def _parse(path: Path, text: str, expected: str) -> tuple[list[int], list[str], list[list[str]]]:
    """Line numbers, header and rows; empty lines are skipped."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines: list[int] = []
    rows: list[list[str]] = []
    try:
        for row in reader:
            if row:
                lines.append(reader.line_num)
                rows.append(row)
    except csv.Error as error:
        raise InputFileError(
            where=f"{path}, line {reader.line_num}",
            seen=f"a row that cannot be split into cells ({error})",
            expected=expected,
            advice="check the quotation marks on that line",
        ) from None
    return lines[1:], [name.strip() for name in rows[0]], rows[1:]


def _check_header(path: Path, header: list[str], needed: Sequence[str], optional: Sequence[str], expected: str) -> None:
    where, seen = f"{path}, header", f"the columns {', '.join(header)}"
    foreign = [name for name in header if name not in needed and name not in optional]
    for name in (n for n in needed if n not in header):
        advice = f"add the column {name}"
        for close in difflib.get_close_matches(name, foreign, n=1, cutoff=0.3):
            advice = f"rename the column {close} to {name}"
        if len(header) == 1:
            advice = "separate the columns by commas, and begin with their names"
        raise InputFileError(where=where, seen=seen, expected=expected, advice=advice)
    for name in (n for n in header if header.count(n) > 1):
        raise InputFileError(where=where, seen=f"{name} twice", expected=expected, advice="keep one of them")
    absent = [name for name in optional if name not in header]
    for name in foreign:
        for close in difflib.get_close_matches(name, absent, n=1, cutoff=0.7):
            advice = f"rename the column {name} to {close}, or to something else if it is not that"
            raise InputFileError(where=where, seen=f"an unknown column {name}", expected=expected, advice=advice)
