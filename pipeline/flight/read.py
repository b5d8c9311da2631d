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
from pipeline.flight.settings import (
    CameraSettings,
    Flight,
    GroundSettings,
    LandmarkSettings,
    SolveSettings,
    TargetSettings,
)
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
    landmarks = _named(top, "landmarks", lambda table, name: sections.landmark(table, name, path.parent))
    ground = top.table("ground")
    top.done()
    if not cameras:
        raise top.refuse("cameras", "at least one [cameras.NAME] table", 'add [cameras.uav1] with calibration = "..."')
    _check_boxes(path, cameras, targets, landmarks)
    found = {} if head is None else read_keys(head, sections.FLIGHT_KEYS, path.parent)
    reference = _reference(head, found.get("reference_camera"), cameras)
    solving = SolveSettings() if solve is None else SolveSettings(**read_keys(solve, sections.SOLVE_KEYS, path.parent))
    level = None if ground is None else sections.ground(ground, path.parent)
    _check_known(path, targets, landmarks, level, solving)
    return Flight(
        path=path,
        title=found.get("title") or path.resolve().parent.name,
        origin=found.get("origin"),
        reference_camera=reference,
        cameras=cameras,
        targets=targets,
        solve=solving,
        ground=level,
        landmarks=landmarks,
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


def _check_known(
    path: Path, targets: tuple[TargetSettings, ...], landmarks: tuple[LandmarkSettings, ...],
    ground: GroundSettings | None, solve: SolveSettings,
) -> None:  # fmt: skip
    """What the ground and landmarks need of the rest of the file."""
    for target in targets:
        if target.on_ground and ground is None:
            raise UsageError(
                where=f"{path}: targets.{target.name}.on_ground", seen="true, without a [ground] table",
                expected="how high the ground is", advice='add [ground] with terrain = "dem.tif" or height_m = 61.2',
            )  # fmt: skip
    for mark in landmarks:
        if mark.name in [t.name for t in targets]:
            raise UsageError(
                where=f"{path}: landmarks.{mark.name}", seen="the name of a target", expected="a name of its own",
                advice="rename one of the two",
            )  # fmt: skip
    known = "landmarks" if landmarks else "ground" if any(t.on_ground for t in targets) else ""
    if known and solve.method != "map":
        raise UsageError(
            where=f"{path}: {known}", seen=f'method = "{solve.method}"', expected='method = "map"',
            advice="only map weighs what is known of the ground and of landmarks: leave solve.method out",
        )  # fmt: skip


def _check_boxes(
    path: Path, cameras: tuple[CameraSettings, ...], targets: tuple[TargetSettings, ...],
    landmarks: tuple[LandmarkSettings, ...],
) -> None:  # fmt: skip
    names = [c.name for c in cameras]
    placed = [(f"targets.{t.name}.boxes", camera) for t in targets for camera in t.boxes]
    placed += [
        (f"landmarks.{m.name}.{key}", c) for m in landmarks for key in ("boxes", "points") for c in getattr(m, key)
    ]
    for key, camera in placed:
        if camera not in names:
            raise UsageError(
                where=f"{path}: {key}.{camera}",
                seen="no such camera",
                expected="one of " + ", ".join(names),
                advice=nearest(camera, names),
            )
