"""Coordinates of surveyed points, in any system that PROJ knows, to WGS84: latitude, longitude, and what heights are.

The horizontal part goes through PROJ's best operation; heights stay what they are, above the ellipsoid or above mean
sea level, and that is told by the system's vertical part, else by whoever calls. Nothing about heights is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError, UsageError
from pipeline.survey.lists import ControlPoint

Datum = Literal["ellipsoid", "msl"]
SEA_LEVEL = ("egm96", "egm2008", "egm84", "mean sea level", "msl")
"""What vertical systems that are mean sea level are called, in small letters."""
COARSE_M = 1.0
"""An operation that PROJ knows to be worse than this is spoken of."""
GIVE_DATUM = 'say --datum ellipsoid (as GNSS receivers give it) or --datum msl (above sea level: "orthometric")'


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Latitude and longitude (n,) in degrees, heights (n,) in metres above `datum`; notes on what is doubtful."""

    lat_deg: Floats
    lon_deg: Floats
    height_m: Floats
    datum: Datum
    system: str
    notes: tuple[str, ...]


def places(points: Sequence[ControlPoint], system: str, *, east_first: bool, datum: Datum | None, where: str) -> Places:
    """The places of points in a coordinate system (EPSG code, PROJ text, WKT, or `WGS84 UTM 16N`).

    `east_first`: the first coordinate is east or longitude, else they are in the order of the system's axes. `where`
    names the list in errors. Raises UsageError where nobody says what heights are, InputFileError for coordinates that
    cannot be, or for a system that is not known.
    """
    pyproj = _pyproj(where)
    crs = _system(pyproj, system, where)
    flat, said, metres = _vertical(crs, where)
    if said is not None and datum is not None and said != datum:
        raise UsageError(
            where="--datum", seen=f'"{datum}", but {crs.name} has heights above {_words(said)}',
            expected=f"{said}, or nothing", advice="leave --datum out: the list's own word is taken",
        )  # fmt: skip
    chosen = said or datum
    if chosen is None:
        raise UsageError(
            where=where, seen=f"{crs.name}, which does not say what heights count from",
            expected="heights above the ellipsoid or above mean sea level", advice=GIVE_DATUM,
        )  # fmt: skip
    first, second = (np.array([getattr(p, side) for p in points]) for side in ("first", "second"))
    swap = not east_first and flat.axis_info[0].direction.lower() in ("north", "south")
    east, north = (second, first) if swap else (first, second)
    move = pyproj.Transformer.from_crs(flat, "EPSG:4326", always_xy=True)
    lon, lat = move.transform(east, north)
    wrong = ~(np.isfinite(lon) & np.isfinite(lat) & (np.abs(lat) <= 90) & (np.abs(lon) <= 180))
    if flat.is_geographic:
        wrong |= (np.abs(north) > 90) | (np.abs(east) > 360)
    if wrong.any():
        point = points[int(np.flatnonzero(wrong)[0])]
        raise InputFileError(
            where=f"{where}: {point.name}", seen=f"{point.first:g}, {point.second:g} in {crs.name}",
            expected="a place on the earth", advice="look at the coordinate system, and at which coordinate is first",
        )  # fmt: skip
    height = metres * np.array([p.height for p in points])
    return Places(
        lat_deg=np.asarray(lat, float), lon_deg=np.asarray(lon, float), height_m=height, datum=chosen,
        system=str(crs.name), notes=_notes(pyproj, move, crs, chosen),
    )  # fmt: skip


def _pyproj(where: str) -> Any:
    try:
        import pyproj
    except ImportError:
        raise InputFileError(
            where=where, seen="coordinates in some system, but pyproj is not installed", expected="pyproj",
            advice="pip install 'runningfix[geoid]'",
        ) from None  # fmt: skip
    return pyproj


def _system(pyproj: Any, text: str, where: str) -> Any:
    utm = re.fullmatch(r"\s*WGS\s*84\s+UTM\s+(\d{1,2})\s*([NS])\s*", text, re.IGNORECASE)
    if utm:
        text = f"EPSG:{(32600 if utm.group(2).upper() == 'N' else 32700) + int(utm.group(1))}"
    try:
        return pyproj.CRS.from_user_input(text)
    except pyproj.exceptions.CRSError:
        raise InputFileError(
            where=where, seen=f'the coordinate system "{text}"', expected="one that PROJ knows",
            advice="write EPSG:32616, a PROJ text that begins with +proj=, or WGS84 UTM 16N",
        ) from None  # fmt: skip


def _vertical(crs: Any, where: str) -> tuple[Any, Datum | None, float]:
    """The horizontal part of a system, what its heights are where it says so, and metres a unit of height."""
    flat = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d() if len(crs.axis_info) == 3 else crs
    if crs.is_geocentric or not (flat.is_geographic or flat.is_projected):
        raise InputFileError(
            where=where, seen=f"{crs.name}, which has no latitude and longitude and no map",
            expected="a geographic or a projected system", advice="convert the list, with PROJ's cs2cs",
        )  # fmt: skip
    if len(crs.axis_info) == 3:
        metres = float(crs.axis_info[2].unit_conversion_factor)
        if not crs.is_compound:
            return flat, "ellipsoid", metres
        name = str(crs.sub_crs_list[1].name).lower()
        return flat, "msl" if any(word in name for word in SEA_LEVEL) else None, metres
    if flat.is_projected and abs(flat.axis_info[0].unit_conversion_factor - 1) > 1e-9:
        raise InputFileError(
            where=where, seen=f"{crs.name}, a map in {flat.axis_info[0].unit_name}, and heights in nobody knows what",
            expected="a system with a vertical part", advice="write one with both, such as EPSG:2227+6360",
        )  # fmt: skip
    return flat, None, 1.0


def _notes(pyproj: Any, move: Any, crs: Any, chosen: Datum) -> tuple[str, ...]:
    try:
        accuracy = float(move.get_last_used_operation().accuracy)
    except pyproj.exceptions.ProjError:
        accuracy = float(move.accuracy)
    found = []
    if accuracy > COARSE_M:
        found.append(f"from {crs.name} to WGS84 PROJ knows a way of {accuracy:g} m only: give --sigma-m accordingly")
    name = str(crs.sub_crs_list[1].name) if crs.is_compound else ""
    if name and chosen == "msl" and not any(word in name.lower() for word in SEA_LEVEL):
        found.append(f"{name} is taken as mean sea level: national systems are decimetres, some a metre, away from it")
    return tuple(found)


def _words(datum: Datum) -> str:
    return "the ellipsoid" if datum == "ellipsoid" else "mean sea level"
