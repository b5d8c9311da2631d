"""Lists of ground control points: OpenDroneMap's `gcp_list.txt`, Pix4D's marks and Pix4D's coordinates.

OpenDroneMap  a line with the coordinate system, then `x y z pixel_x pixel_y picture [name]` (x is east or longitude)
Pix4D marks   `picture, label, pixel_x, pixel_y [, zoom]`, coordinates in a file of their own
Pix4D points  `label, first, second, z [, horizontal accuracy, vertical accuracy]`, in the order of the system's axes

OpenDroneMap gives its pixels to OpenSfM, for which (0, 0) is the middle of the top-left pixel
(`opensfm/features.py`, normalized_image_coordinates: x + 0.5 - width / 2). Pix4D says nowhere which it is; its
principal point of an ideal camera is width / 2, so its (0, 0) is taken as the corner of that pixel.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes

Kind = Literal["OpenDroneMap", "Pix4D"]
CORNER_PX = 0.5
"""What is taken from pixels that count from the corner of the top-left pixel."""
LARGEST_BYTES = 16 << 20
"""Of a list: a hundred thousand marks."""
HELD = "OpenDroneMap's gcp_list.txt, or Pix4D's marks: picture, label, x, y"


@dataclass(frozen=True, kw_only=True)
class ControlPoint:
    """A point: two coordinates and a height in the list's system, as written there; sigmas where the list says them."""

    name: str
    first: float
    second: float
    height: float
    sigma_m: float | None = None
    sigma_up_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class ControlMark:
    """Where a point is seen in a picture; `line` of the list. Pixel (0, 0) is the middle of the top-left pixel."""

    point: str
    picture: str
    x_px: float
    y_px: float
    line: int


@dataclass(frozen=True, kw_only=True)
class ControlList:
    """What a list says.

    system      the coordinate system's name, "" where the list has none
    east_first  the first coordinate is east or longitude; False: in the order of the system's axes
    """

    path: Path
    kind: Kind
    system: str
    east_first: bool
    points: tuple[ControlPoint, ...]
    marks: tuple[ControlMark, ...]


def read_list(path: Path, *, corner: bool | None = None) -> ControlList:
    """The list at `path`; `corner`: its pixels count from the corner of the top-left pixel (None: as its kind does).

    Raises InputFileError, with the line, for what is none or cannot be read.
    """
    lines = _lines(path, HELD)
    if not lines:
        raise _refused(path, 1, "nothing", HELD)
    number, first = lines[0]
    if _system_like(first):
        found = _opendronemap(path, first, lines[1:])
    elif len(_cells(first)) in (4, 5):
        found = _pix4d_marks(path, lines)
    else:
        raise _refused(path, number, f'"{_short(first)}"', HELD)
    if not found.marks:
        raise _refused(path, number, "no mark in any picture", HELD)
    shift = CORNER_PX if (found.kind == "Pix4D" if corner is None else corner) else 0.0
    _check_twice(found)
    return replace(
        found, marks=tuple(replace(m, x_px=m.x_px - shift, y_px=m.y_px - shift) for m in found.marks)
    )  # fmt: skip


def with_coordinates(marks: ControlList, path: Path) -> ControlList:
    """Marks with the coordinates of their points from Pix4D's other file. Raises InputFileError."""
    expected = "Pix4D's points: label, first coordinate, second, height, and perhaps two accuracies"
    points: dict[str, ControlPoint] = {}
    for place, (number, line) in enumerate(_lines(path, expected)):
        cells = _cells(line)
        values = [_number(c) for c in cells[1:]]
        if place == 0 and all(v is None for v in values):
            continue  # a head
        if len(cells) not in (4, 6) or not cells[0] or any(v is None for v in values):
            raise _refused(path, number, f'"{_short(line)}"', expected)
        if cells[0] in points:
            raise _refused(path, number, f'a second point "{cells[0]}"', "one line a point")
        first, second, height, *sigmas = [v for v in values if v is not None]
        if any(s <= 0 for s in sigmas):
            raise _refused(path, number, "an accuracy that is not above zero", "one sigma in metres")
        points[cells[0]] = ControlPoint(
            name=cells[0], first=first, second=second, height=height,
            sigma_m=sigmas[0] if sigmas else None, sigma_up_m=sigmas[1] if sigmas else None,
        )  # fmt: skip
    lacking = sorted({m.point for m in marks.marks} - set(points))
    if lacking:
        raise _refused(path, 1, f'no coordinates of "{lacking[0]}", marked in {marks.path.name}', expected)
    return replace(marks, points=tuple(points.values()))


def _opendronemap(path: Path, system: str, lines: Sequence[tuple[int, str]]) -> ControlList:
    """Points without a name are told apart by their coordinates."""
    points: dict[str, ControlPoint] = {}
    names: dict[tuple[str, ...], str] = {}
    marks = []
    for number, line in lines:
        cells = line.split("\t") if "\t" in line else line.split()
        cells = [c.strip() for c in cells if c.strip()]
        values = [_number(c) for c in cells[:5]]
        if len(cells) < 6 or any(v is None for v in (*values[:2], *values[3:])):
            raise _refused(path, number, f'"{_short(line)}"', "x y z pixel_x pixel_y picture [name]")
        if values[2] is None:
            raise _refused(path, number, f'the height "{cells[2]}"', "a number: a landmark without a height is none")
        east, north, height, x, y = [v for v in values if v is not None]
        name = cells[6] if len(cells) > 6 else names.setdefault(tuple(cells[:3]), f"gcp{len(names) + 1}")
        point = ControlPoint(name=name, first=east, second=north, height=height)
        if points.setdefault(name, point) != point:
            raise _refused(path, number, f'other coordinates of "{name}" than before', "one place a point")
        marks.append(ControlMark(point=name, picture=cells[5], x_px=x, y_px=y, line=number))
    return ControlList(
        path=path, kind="OpenDroneMap", system=system, east_first=True, points=tuple(points.values()),
        marks=tuple(marks),
    )  # fmt: skip


def _pix4d_marks(path: Path, lines: Sequence[tuple[int, str]]) -> ControlList:
    marks = []
    for place, (number, line) in enumerate(lines):
        cells = _cells(line)
        x, y = [_number(c) for c in cells[2:4]] if len(cells) in (4, 5) else (None, None)
        if place == 0 and len(cells) > 3 and x is None and y is None:
            continue  # a head
        if x is None or y is None or not cells[0] or not cells[1]:
            raise _refused(path, number, f'"{_short(line)}"', "picture, label, x, y and perhaps a zoom")
        marks.append(ControlMark(point=cells[1], picture=cells[0], x_px=x, y_px=y, line=number))
    return ControlList(path=path, kind="Pix4D", system="", east_first=False, points=(), marks=tuple(marks))


def _check_twice(found: ControlList) -> None:
    seen: dict[tuple[str, str], int] = {}
    for mark in found.marks:
        before = seen.setdefault((mark.point, mark.picture), mark.line)
        if before != mark.line:
            raise _refused(
                found.path, mark.line, f'"{mark.point}" in {mark.picture}, as in line {before}', "one mark a picture"
            )  # fmt: skip


def _system_like(line: str) -> bool:
    """Whether a line names a coordinate system, as those of gcp_list.txt do."""
    return bool(re.match(r"\s*(EPSG:|\+proj=|WGS84\s+UTM|[A-Z]+(CRS|CS)\[)", line, re.IGNORECASE))


def _lines(path: Path, expected: str) -> list[tuple[int, str]]:
    """Lines with their numbers from 1; empty ones and comments are left out."""
    raw = read_bytes(path, expected=expected, most=LARGEST_BYTES)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _refused(path, 1, "bytes that are no text (UTF-8)", expected) from None
    return [
        (number, line.strip()) for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]  # fmt: skip


def _cells(line: str) -> list[str]:
    mark = next((m for m in (";", ",", "\t") if m in line), ",")
    return [cell.strip().strip('"') for cell in line.split(mark)]


def _number(text: str) -> float | None:
    """A finite number; None of anything else."""
    if not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?", text):
        return None
    value = float(text)
    return value if abs(value) < 1e12 else None


def _short(line: str) -> str:
    return line if len(line) < 60 else line[:57] + "..."


def _refused(path: Path, line: int, seen: str, expected: str) -> InputFileError:
    return InputFileError(
        where=f"{path}: line {line}", seen=seen, expected=expected,
        advice="export the list again, or mend that line",
    )  # fmt: skip
