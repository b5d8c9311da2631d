"""Flight file -> `Flight`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from calibration.foundation.errors import UsageError
from calibration.foundation.files import read_bytes
from pipeline.flight import sections
from pipeline.flight.keys import read_keys
from pipeline.flight.settings import CameraSettings, Flight, SolveSettings, TargetSettings
from pipeline.flight.table import Table, nearest

Item = TypeVar("Item")
LARGEST_BYTES = 1 << 20
"""Of a flight file: room for ten thousand boxes, and two seconds for the TOML reader at worst."""
MOST_DOTS = 32
"""Of a key: for keys of many parts the TOML reader takes time with their square. Ours have four."""


def read_flight(path: Path) -> Flight:
    """The flight that `path` describes. Other files are named, not opened.

    Raises InputFileError where the file is missing or too large, UsageError for every mistake in it.
    """
    return flight_of(read_bytes(path, expected="a flight file (TOML)", most=LARGEST_BYTES), path)


def flight_of(raw: bytes, path: Path) -> Flight:
    """The flight that the text of the file at `path` describes. Raises UsageError for every mistake in it."""
    top = Table(parse_toml(raw, str(path)), f"{path}:")
    head, solve = top.table("flight"), top.table("solve")
    cameras = _named(top, "cameras", lambda table, name: sections.camera(table, name, path.parent))
    targets = _named(top, "targets", lambda table, name: sections.target(table, name, path.parent))
    top.done()
    if not cameras:
        raise top.refuse("cameras", "at least one [cameras.NAME] table", 'add [cameras.uav1] with calibration = "..."')
    _check_boxes(path, cameras, targets)
    found = {} if head is None else read_keys(head, sections.FLIGHT_KEYS, path.parent)
    reference = _reference(head, found.get("reference_camera"), cameras)
    return Flight(
        path=path,
        title=found.get("title") or path.resolve().parent.name,
        origin=found.get("origin"),
        reference_camera=reference,
        cameras=cameras,
        targets=targets,
        solve=SolveSettings() if solve is None else SolveSettings(**read_keys(solve, sections.SOLVE_KEYS, path.parent)),
    )


def parse_toml(raw: bytes, where: str) -> dict[str, Any]:
    """The tables of a TOML text; a byte order mark is skipped.

    Raises UsageError for what is not TOML, and for numbers and nesting beyond all bounds.
    """
    try:
        text = raw.decode("utf-8-sig")
        _check_keys(text)
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also: not UTF-8, a number of thousands of digits
        deep = isinstance(error, RecursionError)
        raise UsageError(
            where=where,
            seen="tables or lists nested too deeply" if deep else f"not valid TOML: {error}",
            expected="a flight file (TOML, UTF-8)",
            advice="mend that line; text needs quotes, tables look like [cameras.uav1]",
        ) from None


def _check_keys(text: str) -> None:
    """Raises ValueError for a key of more parts than any flight file has."""
    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") > MOST_DOTS and not line.lstrip().startswith("#"):
            for piece in re.split("[{,]", line):
                key = piece.split("=", 1)[0] if "=" in piece or piece.lstrip().startswith("[") else ""
                if key.count(".") > MOST_DOTS:
                    raise ValueError(f"a key of {key.count('.') + 1} parts on line {number}")


def _named(top: Table, key: str, read: Callable[[Table, str], Item]) -> tuple[Item, ...]:
    table = top.table(key)
    return () if table is None else tuple(read(table.named(name), name) for name in table.content)


def _reference(head: Table | None, name: str | None, cameras: tuple[CameraSettings, ...]) -> str:
    names = [c.name for c in cameras]
    if head is not None and name is not None and name not in names:
        raise head.refuse("reference_camera", "one of " + ", ".join(f'"{n}"' for n in names), nearest(name, names))
    return name or names[0]


def _check_boxes(path: Path, cameras: tuple[CameraSettings, ...], targets: tuple[TargetSettings, ...]) -> None:
    names = [c.name for c in cameras]
    for target in targets:
        for camera in target.boxes:
            if camera not in names:
                raise UsageError(
                    where=f"{path}: targets.{target.name}.boxes.{camera}",
                    seen="no such camera",
                    expected="one of " + ", ".join(names),
                    advice=nearest(camera, names),
                )
