"""Which column is what, by its header: the name, and the unit that stands behind it.

AirData   time(millisecond), datetime(utc), latitude, height_above_takeoff(feet), gimbal_heading(degrees), isVideo
DJI       CUSTOM.updateTime [local], OSD.flyTime [s], OSD.latitude, OSD.height [ft], GIMBAL.yaw, CAMERA.isVideo
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from calibration.foundation.errors import InputFileError

Dialect = Literal["airdata", "dji"]
DELIMITERS = (",", ";", "\t")
CELL = re.compile(r"^\s*(?P<name>[^\[(]*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*)[\])])?\s*$")
UNITS: Mapping[str, float] = {"": 1.0, "m": 1.0, "meters": 1.0, "ft": 0.3048, "feet": 0.3048, "degrees": 1.0, "s": 1.0,
                              "millisecond": 1e-3, "ms": 1e-3, "deg": 1.0, "\N{DEGREE SIGN}": 1.0,
                              "rad": 180 / math.pi}  # fmt: skip
NAMES: Mapping[Dialect, Mapping[str, tuple[str, ...]]] = {
    "airdata": {
        "time": ("time",), "clock": ("datetime",), "lat": ("latitude",), "lon": ("longitude",),
        "above_home": ("height_above_takeoff",), "above_sea": ("altitude_above_sealevel",),
        "yaw": ("compass_heading",), "pitch": ("pitch",), "roll": ("roll",),
        "gimbal_yaw": ("gimbal_heading",), "gimbal_pitch": ("gimbal_pitch",), "gimbal_roll": ("gimbal_roll",),
        "video": ("isvideo",),
    },
    "dji": {
        "time": ("osd.flytime",), "date": ("custom.date",), "clock": ("custom.datetime", "custom.updatetime"),
        "lat": ("osd.latitude", "osd.lalitude"), "fixed": ("osd.isgpsused",),
        "lon": ("osd.longitude",), "above_home": ("osd.height",), "above_sea": ("osd.altitude",),
        "yaw": ("osd.yaw",), "pitch": ("osd.pitch",), "roll": ("osd.roll",),
        "gimbal_yaw": ("gimbal.yaw",), "gimbal_pitch": ("gimbal.pitch",), "gimbal_roll": ("gimbal.roll",),
        "video": ("camera.isvideo", "custom.isvideo"),
    },
}  # fmt: skip
"""What we ask for -> how its columns begin, in small letters."""
LENGTHS = ("above_home", "above_sea")
"""Columns that have to say their unit."""
TEXTS = ("date", "clock", "video", "fixed")
"""Columns that are no numbers."""
METRIC = "custom.datetime"
"""A column by which a decoder is known that writes metres, and UTC, and says neither."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Where a column is, what turns its numbers into SI, and the unit as it is written."""

    place: int
    scale: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class Header:
    """A flight record's dialect and the columns that are in it."""

    dialect: Dialect
    columns: Mapping[str, Column]
    delimiter: str = ","


def header_of(line: str) -> Header | None:
    """The header of a flight record in a line, whatever parts its cells; None where it is none."""
    for delimiter in DELIMITERS:
        found = read_header(next(csv.reader([line.strip()], delimiter=delimiter), []))
        if found is not None:
            return replace(found, delimiter=delimiter)
    return None


def read_header(cells: Sequence[str]) -> Header | None:
    """The header of a flight record; None where cells are none."""
    named: list[tuple[str, str]] = []
    for cell in cells:
        found = CELL.match(cell)
        named.append((found["name"].lower(), (found["unit"] or "").strip().lower()) if found else ("", ""))
    if any(name == METRIC for name, _ in named):
        silent = {METRIC: "utc"} | {name: "m" for what in LENGTHS for name in NAMES["dji"][what]}
        named = [(name, unit or silent.get(name, "")) for name, unit in named]
    there = set(named)
    if ("time", "millisecond") in there and {("latitude", ""), ("longitude", "")} <= there:
        return Header(dialect="airdata", columns=_columns("airdata", named))
    names = {name for name, _ in there}
    if "osd.longitude" in names and not names.isdisjoint(NAMES["dji"]["lat"]):
        return Header(dialect="dji", columns=_columns("dji", named))
    return None


def check_units(header: Header, path: Path) -> None:
    """Raises InputFileError where a height's unit is not said, or any number's is unknown."""
    for what in LENGTHS:
        length = header.columns.get(what)
        if length is not None and length.unit not in ("m", "meters", "ft", "feet"):
            raise InputFileError(
                where=f"{path}, line 1",
                seen=f"heights in {length.unit!r}" if length.unit else "heights without a unit",
                expected="metres or feet, in the column's header",
                advice="export the record again, or write [m] or [ft] behind the column's name",
            )
    for what, column in header.columns.items():
        if what not in TEXTS and column.unit not in UNITS:
            raise InputFileError(
                where=f"{path}, line 1",
                seen=f"{what.replace('_', ' ')} in {column.unit!r}",
                expected=f"one of {', '.join(unit for unit in UNITS if unit)}, in the column's header",
                advice="export the record again, in metres, degrees and seconds",
            )


def _columns(dialect: Dialect, named: Sequence[tuple[str, str]]) -> dict[str, Column]:
    """The first column of each; one in metres rather than in feet, one in seconds rather than in words."""
    found: dict[str, Column] = {}
    for what, names in NAMES[dialect].items():
        places = [i for name in names for i, (cell, _) in enumerate(named) if cell == name]
        places.sort(key=lambda i: named[i][1] not in ("m", "meters", "s"))
        if places:
            unit = named[places[0]][1]
            found[what] = Column(place=places[0], scale=UNITS.get(unit, 1.0), unit=unit)
    return found
