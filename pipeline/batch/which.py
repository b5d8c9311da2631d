"""Which flights are meant: names, patterns, folders and tables, here or by URL; and what each is called."""

from __future__ import annotations

import glob
import hashlib
import io
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from calibration.foundation.errors import InputFileError, UsageError
from calibration.foundation.files import read_bytes
from pipeline.batch.places import as_path, file_system, is_url, matching, reaching

TABLES = (".csv", ".parquet")
MOST_TABLE_BYTES = 1 << 28
FLIGHT_FILE = "flight.toml"
LONGEST_NAME = 80


@dataclass(frozen=True, kw_only=True)
class NamedFlight:
    """A flight file, as an absolute path or a URL, and what its flight is called in the data set."""

    name: str
    source: str


def find_flights(given: Sequence[str]) -> tuple[NamedFlight, ...]:
    """The flights of names, patterns, folders and tables, each once, in the order in which they were given.

    A table has a column `flight` (paths relative to it, or URLs) and may have one `name`. A flight without a name is
    called by its folder and eight digits of a hash of its place, so that it is the same whoever else is in the batch.
    Raises UsageError, InputFileError.
    """
    found: dict[str, NamedFlight] = {}
    for text in given:
        for source, name in _sources(text):
            found.setdefault(source, NamedFlight(name=name or _name_of(source), source=source))
    if not found:
        raise UsageError(
            where="FLIGHTS", seen="no flight file", expected="flight files, patterns, folders or tables of them",
            advice="quote a pattern: 'flights/*/flight.toml'",
        )  # fmt: skip
    _check_names(found.values())
    return tuple(found.values())


def _sources(text: str) -> Iterable[tuple[str, str]]:
    """(where, name or "") of the flight files that one argument stands for."""
    if PurePosixPath(text).suffix.lower() in TABLES:
        return _of_table(text)
    here = as_path(text)
    return [(source, "") for source in (_by_url(text) if here is None else _by_path(here))]


def _by_path(path: Path) -> list[str]:
    if path.is_dir():
        return [os.path.abspath(path / FLIGHT_FILE)]
    if path.exists() or not glob.has_magic(str(path)):
        return [os.path.abspath(path)]
    found = sorted(glob.glob(str(path), recursive=True))
    if not found:
        raise InputFileError(
            where=str(path), seen="nothing matches", expected="a pattern of flight files",
            advice=f"patterns are looked for from {Path.cwd()}",
        )  # fmt: skip
    return [source for name in found for source in _by_path(Path(name))]


def _by_url(url: str) -> list[str]:
    if not glob.has_magic(url):
        return [url]
    found = matching(url)
    if not found:
        raise InputFileError(
            where=url, seen="nothing matches", expected="a pattern of flight files", advice="check it with its own tool"
        )
    return found


def _of_table(text: str) -> list[tuple[str, str]]:
    import pandas as pd

    here = as_path(text)
    what = "a table of flights, with a column `flight`"
    if here is not None:
        raw = read_bytes(here, expected=what, most=MOST_TABLE_BYTES)
    else:
        system = file_system(text)
        with reaching(text), system.open(text, "rb") as file:
            raw = file.read(MOST_TABLE_BYTES)
    try:
        read: Any = pd.read_parquet if text.lower().endswith(".parquet") else _read_csv
        table = read(io.BytesIO(raw))
        names = table["name"].astype(str).tolist() if "name" in table else [""] * len(table)
        flights = table["flight"].astype(str).tolist()
    except Exception as error:  # pandas and pyarrow raise nearly anything
        seen = "no column `flight`" if isinstance(error, KeyError) else f"cannot be read ({error})"
        raise InputFileError(where=text, seen=seen, expected=what, advice="write a column of flight files") from None
    return [(_beside(text, flight), name) for flight, name in zip(flights, names, strict=True)]


def _read_csv(raw: io.BytesIO) -> Any:
    import pandas as pd

    return pd.read_csv(raw, dtype=str, keep_default_na=False, encoding="utf-8-sig")


def _beside(table: str, flight: str) -> str:
    """Where a flight of a table is."""
    if is_url(flight):
        here = as_path(flight)
        return flight if here is None else os.path.abspath(here)
    table_here = as_path(table)
    if table_here is not None:
        return os.path.abspath(table_here.parent / flight)
    return f"{table.rpartition('/')[0]}/{flight}"


def _name_of(source: str) -> str:
    path = PurePosixPath(source.replace("\\", "/"))
    words = path.parent.name if path.name == FLIGHT_FILE else path.stem
    readable = re.sub(r"[^A-Za-z0-9_-]+", "-", words).strip("-")[:LONGEST_NAME] or "flight"
    return f"{readable}-{hashlib.sha256(source.encode()).hexdigest()[:8]}"


def _check_names(flights: Iterable[NamedFlight]) -> None:
    known: dict[str, str] = {}
    for flight in flights:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}", flight.name):
            raise UsageError(
                where=f"name of {flight.source}", seen=repr(flight.name),
                expected="letters, digits, - _ . (it names a folder)", advice="rename it in the table",
            )  # fmt: skip
        if known.setdefault(flight.name.lower(), flight.source) != flight.source:
            raise UsageError(
                where=f"name of {flight.source}", seen=f"{flight.name}, which {known[flight.name.lower()]} has too",
                expected="a name for each flight", advice="rename one in the table",
            )  # fmt: skip
