"""Mean sea level above the ellipsoid: EGM2008 where PROJ and its grid are installed, else the EGM96 that comes with us.

The grid is PROJ's own (us_nga_egm08_25.tif, 2.5 minutes: `projsync --file us_nga_egm08_25`); nothing is fetched here.
Between the two models lie some decimetres, in mountains metres: which one was used is said wherever a height rests on
it.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.telemetry.heights import egm96

GRIDS = ("us_nga_egm08_25.tif", "egm08_25.gtx")


def geoid_height_m(lat_rad: Floats, lon_rad: Floats) -> Floats:
    """Height (n,) of mean sea level above the WGS84 ellipsoid; NaN where a place is."""
    grid = _egm2008()
    if grid is None:
        return egm96.geoid_height_m(lat_rad, lon_rad)
    lat, lon = np.degrees(np.asarray(lat_rad, float)), np.degrees(np.asarray(lon_rad, float))
    known = np.isfinite(lat + lon)
    turn = np.mod(np.where(known, lon, 0.0) + 180.0, 360.0) - 180.0
    height = grid.transform(turn, np.where(known, lat, 0.0), np.zeros(len(lat)))[2]
    return np.where(known & np.isfinite(height), height, np.nan)


def geoid_name() -> str:
    """The model in force."""
    return "EGM96" if _egm2008() is None else "EGM2008"


@cache
def _egm2008() -> Any:
    """PROJ's shift from mean sea level to the ellipsoid by its grid; None where either is not there."""
    if not _may_be_there():
        return None
    try:
        import pyproj
    except ImportError:
        return None
    for grid in GRIDS:
        try:
            return pyproj.Transformer.from_pipeline(
                f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=vgridshift +grids={grid}"
                " +multiplier=1 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
            )
        except pyproj.exceptions.ProjError:
            continue
    return None


def _may_be_there() -> bool:
    """Whether a grid lies where PROJ looks: to ask PROJ itself takes a fifth of a second."""
    if os.environ.get("PROJ_NETWORK", "").upper() in ("ON", "YES", "TRUE"):
        return True
    return any((place / grid).is_file() for grid in GRIDS for place in _places())


def _places() -> list[Path]:
    """Folders in which PROJ, as pyproj sets it up, looks for grids."""
    here = importlib.util.find_spec("pyproj")
    if here is None or not here.submodule_search_locations:
        return []
    named = [os.environ.get(name, "") for name in ("PROJ_DATA", "PROJ_LIB", "PROJ_USER_WRITABLE_DIRECTORY")]
    if "pyproj" in sys.modules:  # a caller may have set it up otherwise
        named.append(sys.modules["pyproj"].datadir.get_data_dir())
    of_user = ("XDG_DATA_HOME", ".local/share"), ("LOCALAPPDATA", "AppData/Local"), ("", "Library/Application Support")
    own = [os.environ.get(name) or Path.home() / usual for name, usual in of_user]
    around = (Path(here.submodule_search_locations[0]) / "proj_dir", Path(sys.prefix), Path(sys.prefix) / "Library",
              Path("/usr"), Path("/usr/local"))  # fmt: skip
    return [
        *(Path(one) for several in named for one in several.split(os.pathsep) if one),
        *(Path(one) / "proj" for one in own),
        *(one / "share" / "proj" for one in around),
    ]
