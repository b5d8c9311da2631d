"""What a terrain model's heights count from, and in what unit: its own word first, then the flight file's.

"ellipsoid" is WGS84 or a datum within decimetres of it (ETRS89, GRS80); "msl" is mean sea level by EGM96, which other
geoids and national height systems are near to within a metre or two. A model that says nothing is not guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from calibration.foundation.errors import InputFileError

Datum = Literal["ellipsoid", "msl"]
ADVICE = 'write datum = "ellipsoid" or datum = "msl" in [ground], as whoever made the model says'
GEOIDS = ("egm96", "egm2008", "egm84", "egm08", "mean sea level", "msl")
"""What vertical systems that are mean sea level are called, in small letters."""
METRES = {
    "": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "m": 1.0, "foot": 0.3048, "ft": 0.3048,
    "feet": 0.3048, "us survey foot": 1200 / 3937, "us_survey_foot": 1200 / 3937, "foot_us": 1200 / 3937,
    "ftus": 1200 / 3937, "us-ft": 1200 / 3937, "centimetre": 0.01, "cm": 0.01, "decimetre": 0.1, "dm": 0.1,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Heights:
    """What heights count from, metres a unit, and who says so."""

    datum: Datum
    metres: float
    source: str


def vertical_name(wkt: str) -> str | None:
    """The name of the vertical part of a coordinate system; "" of one with ellipsoidal heights; None: it has none."""
    found = re.search(r'VERT(?:_CS|CRS|ICALCRS)\["([^"]*)"', wkt)
    if found:
        return found.group(1)
    three = re.search(r"CS\[ellipsoidal,\s*3\]", wkt) or re.search(r"CS\[Cartesian,\s*3\]", wkt)
    up = re.search(r'AXIS\["(Ellipsoidal height|Up)[^"]*",\s*UP', wkt, re.IGNORECASE)
    return "" if three or up else None


def vertical_unit(wkt: str) -> float | None:
    """Metres a unit of the vertical part; None where it has none."""
    found = re.search(r"VERT(?:_CS|CRS|ICALCRS)\[.*", wkt, re.DOTALL)
    unit = re.search(r'(?:LENGTHUNIT|UNIT)\["[^"]*",\s*([0-9.eE+-]+)', found.group(0)) if found else None
    return float(unit.group(1)) if unit else None


def heights_of(wkt: str, unit: str | None, asked: Datum | None, where: str, key: str) -> Heights:
    """What the heights of the model `where` are, by its coordinate system, its band's unit and the flight file's key.

    Raises InputFileError where nobody says, where both say different things, or for a unit that nobody knows.
    """
    name, metres = vertical_name(wkt), vertical_unit(wkt)
    word = (unit or "").strip().lower()
    if metres is None or word:
        if word not in METRES:
            raise InputFileError(
                where=where, seen=f'heights in "{unit}"', expected="metres or feet",
                advice="convert the model, with gdal_translate -scale or gdal_calc",
            )  # fmt: skip
        metres = METRES[word]
    own: Datum | None = None
    if name == "":
        own = "ellipsoid"
    elif name is not None and any(g in name.lower() for g in GEOIDS):
        own = "msl"
    if own is not None and asked is not None and own != asked:
        raise InputFileError(
            where=key,
            seen=f'"{asked}", but {where} has heights above {name or "the ellipsoid"}',
            expected=f'datum = "{own}", or no datum at all',
            advice="leave datum out: the model's own word is taken",
        )
    if own is None and asked is None:
        said = "nothing of what its heights count from" if name is None else f'heights in "{name}"'
        raise InputFileError(where=where, seen=said, expected="heights above the ellipsoid or above mean sea level",
                             advice=ADVICE)  # fmt: skip
    return Heights(
        datum=own or asked or "msl", metres=metres,
        source="the model's own coordinate system" if own else f"{key}, as the model does not say it",
    )  # fmt: skip
