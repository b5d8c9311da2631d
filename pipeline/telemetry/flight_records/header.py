"""Which column is what, by its header: the name, and the unit that stands behind it.

AirData   time(millisecond), datetime(utc), latitude, height_above_takeoff(feet), gimbal_heading(degrees), isVideo
DJI       CUSTOM.updateTime [local], OSD.flyTime [s], OSD.latitude, OSD.height [ft], GIMBAL.yaw, CAMERA.isVideo
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from calibration.foundation.errors import InputFileError

Dialect = Literal["airdata", "dji"]
CELL = re.compile(r"^\s*(?P<name>[^\[(]*?)\s*(?:[\[(]\s*(?P<unit>[^\])]*)[\])])?\s*$")
UNITS: Mapping[str, float] = {"": 1.0, "m": 1.0, "meters": 1.0, "ft": 0.3048, "feet": 0.3048, "degrees": 1.0, "s": 1.0,
                              "millisecond": 1e-3}  # fmt: skip
NAMES: Mapping[Dialect, Mapping[str, tuple[str, ...]]] = {
    "airdata": {
        "time": ("time",), "clock": ("datetime",), "lat": ("latitude",), "lon": ("longitude",),
        "above_home": ("height_above_takeoff",), "above_sea": ("altitude_above_sealevel",),
        "yaw": ("compass_heading",), "pitch": ("pitch",), "roll": ("roll",),
        "gimbal_yaw": ("gimbal_heading",), "gimbal_pitch": ("gimbal_pitch",), "gimbal_roll": ("gimbal_roll",),
        "video": ("isvideo",),
    },
    "dji": {
        "time": ("osd.flytime",), "date": ("custom.date",), "clock": ("custom.updatetime",), "lat": ("osd.latitude",),
        "lon": ("osd.longitude",), "above_home": ("osd.height",), "above_sea": ("osd.altitude",),
        "yaw": ("osd.yaw",), "pitch": ("osd.pitch",), "roll": ("osd.roll",),
        "gimbal_yaw": ("gimbal.yaw",), "gimbal_pitch": ("gimbal.pitch",), "gimbal_roll": ("gimbal.roll",),
        "video": ("camera.isvideo", "custom.isvideo"),
    },
}  # fmt: skip
"""What we ask for -> how its columns begin, in small letters."""
LENGTHS = ("above_home", "above_sea")
"""Columns that have to say their unit."""


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


def read_header(cells: Sequence[str]) -> Header | None:
    """The header of a flight record; None where cells are none."""
    named: list[tuple[str, str]] = []
    for cell in cells:
        found = CELL.match(cell)
        named.append((found["name"].lower(), (found["unit"] or "").strip().lower()) if found else ("", ""))
    there = set(named)
    if ("time", "millisecond") in there and {("latitude", ""), ("longitude", "")} <= there:
        return Header(dialect="airdata", columns=_columns("airdata", named))
    if {"osd.latitude", "osd.longitude"} <= {name for name, _ in there}:
        return Header(dialect="dji", columns=_columns("dji", named))
    return None


def check_units(header: Header, path: Path) -> None:
    """Raises InputFileError where a height's unit is not said, or unknown."""
    for what in LENGTHS:
        column = header.columns.get(what)
        if column is not None and column.unit not in ("m", "meters", "ft", "feet"):
            raise InputFileError(
                where=f"{path}, line 1",
                seen=f"heights in {column.unit!r}" if column.unit else "heights without a unit",
                expected="metres or feet, in the column's header",
                advice="export the record again, or write [m] or [ft] behind the column's name",
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
