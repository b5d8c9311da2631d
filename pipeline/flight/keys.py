"""How one key of a flight file is read: a row of a section's table names the key, the setting it becomes, and a reader.

A reader takes the table, the key and the folder that paths are relative to; it raises UsageError with the key's place.
Degrees in the file are radians in the settings. A new key is one row in `sections` and one field in `settings`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.flight.settings import AUTO, CAMERA_EVENT, IN_THE_VIDEO
from pipeline.flight.table import Table

Reader = Callable[[Table, str, Path], Any]


class Key(NamedTuple):
    """One row: a key, how it is read, and the setting it becomes (the key's own name where that is None)."""

    key: str
    read: Reader
    setting: str | None = None


def read_keys(table: Table, keys: Sequence[Key], folder: Path) -> dict[str, Any]:
    """The settings of a section, by name, in the order of its keys; what is not a key there is refused."""
    found = {row.setting or row.key: row.read(table, row.key, folder) for row in keys}
    table.done()
    return found


def given(found: dict[str, Any]) -> dict[str, Any]:
    """Only what the file gave."""
    return {name: value for name, value in found.items() if value is not None}


def number(
    default: float | None = None, *, low: float = -math.inf, high: float = math.inf, above: bool = False
) -> Reader:
    """A finite number between `low` and `high`; with `above`, strictly greater than `low`."""
    return lambda table, key, _: table.number(key, default, low=low, high=high, above=above)


def needed_number(advice: str, *, expected: str, low: float = -math.inf, high: float = math.inf) -> Reader:
    """A number that must be there."""

    def read(table: Table, key: str, _: Path) -> float:
        value = table.number(key, low=low, high=high)
        if value is None:
            raise table.refuse(key, expected, advice)
        return value

    return read


def degrees(default: float | None = 0.0, *, low: float = -360.0, high: float = 360.0) -> Reader:
    """An angle in degrees; radians come out."""

    def read(table: Table, key: str, _: Path) -> float | None:
        value = table.number(key, default, low=low, high=high)
        return None if value is None else math.radians(value)

    return read


def whole(default: int | None = None, *, low: int = 0, high: int = 2**31 - 1) -> Reader:
    """A whole number."""

    def read(table: Table, key: str, _: Path) -> int | None:
        value = table.whole(key, low=low, high=high)
        return default if value is None else value

    return read


def truth(default: bool = False) -> Reader:
    """true or false."""

    def read(table: Table, key: str, _: Path) -> bool:
        value = table.get(key)
        if value is None:
            return default
        if not isinstance(value, bool):
            raise table.refuse(key, "true or false", f"write {key} = true")
        return value

    return read


def text() -> Reader:
    """Text that is not empty."""
    return lambda table, key, _: table.text(key)


def choice(allowed: Iterable[Any], default: Any) -> Reader:
    """One of `allowed`."""
    options = tuple(allowed)
    return lambda table, key, _: table.choice(key, options, default)


def vector(default: Sequence[float]) -> Reader:
    """A list of as many finite numbers as `default` has."""

    def read(table: Table, key: str, _: Path) -> tuple[float, ...]:
        return table.vector(key, len(default)) or tuple(default)

    return read


def path(needed: str = "") -> Reader:
    """A file, relative to the folder; `needed` says how to come by it where it must be given."""

    def read(table: Table, key: str, folder: Path) -> Path | None:
        name = table.text(key)
        if name is None and needed:
            raise table.refuse(key, f"the file of the camera's {key}", needed)
        return None if name is None else folder / name

    return read


def telemetry(table: Table, key: str, folder: Path) -> Path | None:
    """A flight log or a table of poses, relative to the folder, or the camera's video where that carries the log."""
    name = table.text(key)
    if name != IN_THE_VIDEO:
        return None if name is None else folder / name
    video = table.text("video")
    if video is None:
        raise table.refuse(key, "a camera with a video", 'write video = "clip.ts", or name the log')
    return folder / video


def dialect(table: Table, key: str, folder: Path) -> str:
    """The name of one of pymavlink's dialects, or the path of a file of message definitions."""
    name = table.text(key) or ""
    return str(folder / name) if name.endswith(".xml") else name


def start(table: Table, key: str, _: Path) -> float | str | None:
    """Log time of frame 0: seconds, a UTC time, or in words."""
    value = table.get(key)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, str):
        if value not in (CAMERA_EVENT, AUTO):
            try:
                datetime.fromisoformat(value)
            except ValueError:
                raise table.refuse(
                    key,
                    'seconds, an ISO-8601 UTC time, "camera-event" or "auto"',
                    'write start = "2025-06-01T09:30:00Z"',
                ) from None
        return value
    return table.number(key)


def number_or(word: str) -> Reader:
    """A number, or a word that stands for None."""

    def read(table: Table, key: str, _: Path) -> float | None:
        return None if table.get(key) == word else table.number(key)

    return read


def section(keys: Sequence[Key], make: Callable[..., Any], default: Any = None) -> Reader:
    """A table inside a table, as `make` of its settings; `default` where it is not there."""

    def read(table: Table, key: str, folder: Path) -> Any:
        inner = table.table(key)
        return default if inner is None else make(**read_keys(inner, keys, folder))

    return read
