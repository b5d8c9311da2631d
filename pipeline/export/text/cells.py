"""Values as the files show them: exact or sensibly rounded, missing ones as empty cells, times as ISO-8601 UTC.

exact        the shortest decimal that reads back as the same float64
rounded      so many decimals; trailing zeros fall away
significant  so many significant digits, for what spans orders of magnitude (variances)
fixed        always so many decimals, never an exponent: XML's `decimal` knows none
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from calibration.foundation.arrays import Floats

Cell = str | int | float
_MUST_BE_QUOTED = re.compile('[,"\r\n]')


def exact(values: Floats) -> list[Cell]:
    """Cells of (n,) numbers that read back bit for bit."""
    return ["" if math.isnan(v) else v for v in np.asarray(values, float).tolist()]


def rounded(values: Floats, decimals: int) -> list[Cell]:
    """Cells of (n,) numbers with at most so many decimals."""
    return ["" if math.isnan(v) else round(v, decimals) + 0.0 for v in np.asarray(values, float).tolist()]


def significant(values: Floats, digits: int) -> list[Cell]:
    """Cells of (n,) numbers with at most so many significant digits."""
    return ["" if math.isnan(v) else float(f"{v:.{digits}g}") for v in np.asarray(values, float).tolist()]


def fixed(value: float, decimals: int) -> str:
    """`value` with exactly so many decimals; no minus before zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and float(text) == 0 else text


def table(header: Sequence[str], columns: Sequence[Iterable[Cell]]) -> str:
    """Comma-separated text of equally long columns (RFC 4180, but lines end in a bare line feed)."""
    texts = [_texts(list(column)) for column in columns]
    lines = [",".join(header), *(",".join(row) for row in zip(*texts, strict=True))]
    return "\n".join(lines) + "\n"


def utc_texts(utc_at_zero_s: float, time_s: Floats) -> list[str]:
    """ISO-8601 UTC of common times (n,), to the microsecond, as 2025-03-01T12:00:00.100000Z.

    Both are rounded to whole microseconds before they are added: a double of POSIX seconds resolves 0.24 us only.
    """
    micros = round(utc_at_zero_s * 1e6) + np.rint(np.asarray(time_s, float) * 1e6).astype(np.int64)
    return [f"{text}Z" for text in np.datetime_as_string(micros.astype("datetime64[us]"), unit="us").tolist()]


def _texts(cells: list[Cell]) -> Iterable[str]:
    """The cells as text; of names, which come again and again, each is looked at once."""
    kinds = set(map(type, cells))
    if str not in kinds:
        return map(repr, cells)
    if kinds == {str}:
        known = {cell: _cell_text(cell) for cell in set(cells)}
        return map(known.__getitem__, cells)
    return map(_cell_text, cells)


def _cell_text(cell: Cell) -> str:
    if not isinstance(cell, str):
        return repr(cell)
    return '"' + cell.replace('"', '""') + '"' if _MUST_BE_QUOTED.search(cell) else cell
