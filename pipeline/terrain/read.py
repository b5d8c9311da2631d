"""A GeoTIFF terrain model around a flight, with its own coordinate system, units and vertical datum.

Only the part within `REACH_M` of the cameras is read. GDAL (through rasterio) knows the projections; what lies between
them and the flight's ENU is fitted once by polynomials (`mapping.py`).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from pipeline.geometry.geodesy import Geodetic, geodetic_from_enu
from pipeline.records import GroundAt, GroundHeights
from pipeline.terrain.datum import Datum, heights_of
from pipeline.terrain.level import Geoid
from pipeline.terrain.mapping import Smooth, fitted
from pipeline.terrain.surface import Surface

REACH_M, MOST_CELLS = 3000.0, 25_000_000
"""How far from the cameras ground is read, and how many cells at most (100 MB): with finer cells the reach is less."""
MISSED_CELLS = 0.05
"""By how much a polynomial may miss a cell's place."""
ADVICE = "give a GeoTIFF of heights with a coordinate system, such as a terrain model (DTM)"


@dataclass(frozen=True, kw_only=True, eq=False)
class TerrainModel:
    """Heights around a flight; `cell_m` a side; `words` say what it is."""

    at: GroundAt
    cell_m: float
    words: str


def read_terrain(
    path: Path, *, origin: Geodetic, around_m: Floats, geoid: Geoid, datum: Datum | None = None, key: str = "datum"
) -> TerrainModel:
    """The terrain model `path` around places (n, 2) in ENU at `origin`.

    `geoid` brings heights above mean sea level to the ellipsoid; `datum` is the flight file's word, `key` its place.
    Raises InputFileError where it cannot be read, does not say what it is, or lies elsewhere.
    """
    rasterio = _rasterio(path)
    with warnings.catch_warnings(), rasterio.Env():
        warnings.simplefilter("ignore")
        try:
            with rasterio.open(path) as raster:
                return _read(raster, path, origin, around_m, geoid, datum, key)
        except rasterio.errors.RasterioError as error:
            raise InputFileError(
                where=str(path), seen=f"cannot be read: {error}", expected="a GeoTIFF terrain model", advice=ADVICE
            ) from error


def _rasterio(path: Path) -> Any:
    try:
        import rasterio
        import rasterio.warp
    except ImportError as error:
        raise InputFileError(
            where=str(path), seen="a terrain model, but rasterio is not installed", expected="rasterio",
            advice="pip install 'runningfix[terrain]', or give height_m in [ground]",
        ) from error  # fmt: skip
    return rasterio


def _read(
    raster: Any, path: Path, origin: Geodetic, around_m: Floats, geoid: Geoid, datum: Datum | None, key: str
) -> TerrainModel:
    if raster.crs is None or raster.transform.is_identity:
        raise InputFileError(
            where=str(path), seen="no coordinate system, or no place in it", expected="a georeferenced raster",
            advice=ADVICE,
        )  # fmt: skip
    heights = heights_of(raster.crs.to_wkt(version="WKT2_2019"), raster.units[0], datum, str(path), key)
    centre = 0.5 * (around_m.min(axis=0) + around_m.max(axis=0))
    half = 0.5 * float(np.ptp(around_m, axis=0).max()) + REACH_M
    cells = _cells(raster, path, origin, centre, half, up_m=0.0)
    cell_m = _cell_m(cells, centre)
    half = min(half, 0.5 * cell_m * float(np.sqrt(MOST_CELLS)))
    up = _middle(raster, cells, centre, heights.metres) - origin.height_m
    cells = _cells(raster, path, origin, centre, half, up_m=up)
    values, corner = _window(raster, path, cells, centre, half, around_m)
    sea = heights.datum == "msl"

    def lift(place_m: Floats) -> Floats:
        """ENU up less the model's height: the earth's curvature, and the geoid."""
        place = geodetic_from_enu(np.column_stack([place_m, np.full(len(place_m), up)]), origin)
        above = geoid(place[:, 0], place[:, 1]) if sea else 0.0
        return np.asarray(up - place[:, 2] + above)[:, None]

    moved = Smooth(centre_m=cells.centre_m, half_m=cells.half_m, coefficients=cells.coefficients.copy())
    moved.coefficients[0, 0] -= corner
    surface = Surface(values * np.float32(heights.metres), moved, fitted(lift, centre, half)[0])

    def at(place_m: Floats) -> GroundHeights:
        up_m, slope, rough, known = surface.at(place_m)
        return GroundHeights(up_m=up_m, slope=slope, rough_m=rough, known=known)

    what = "mean sea level" if sea else "the ellipsoid"
    words = f"{path.name} (cells of {cell_m:.3g} m, {_name(raster)}, heights above {what} by {heights.source})"
    return TerrainModel(at=at, cell_m=cell_m, words=words)


def _name(raster: Any) -> str:
    code = raster.crs.to_epsg()
    return f"EPSG:{code}" if code else "a coordinate system without a number"


def _cells(raster: Any, path: Path, origin: Geodetic, centre_m: Floats, half_m: float, up_m: float) -> Smooth:
    """Column and row (middles of cells are whole) of places at `up_m`."""
    from rasterio.warp import transform

    def column_row(place_m: Floats) -> Floats:
        place = geodetic_from_enu(np.column_stack([place_m, np.full(len(place_m), up_m)]), origin)
        x, y = transform("EPSG:4326", _flat(raster.crs), np.degrees(place[:, 1]), np.degrees(place[:, 0]))[:2]
        column, row = ~raster.transform * np.stack([np.asarray(x), np.asarray(y)])
        return np.stack([column, row], axis=1) - 0.5

    try:
        found, missed = fitted(column_row, centre_m, half_m)
    except (np.linalg.LinAlgError, ValueError):
        missed = np.array([np.inf])
    if not (np.isfinite(missed).all() and missed.max() < MISSED_CELLS):
        raise InputFileError(
            where=str(path), seen=f"its coordinate system ({_name(raster)}) does not reach the flight",
            expected="a terrain model of the place of the flight", advice="check flight.origin and the model",
        )  # fmt: skip
    return found


def _flat(crs: Any) -> Any:
    """The horizontal part of a coordinate system: heights are ours."""
    from rasterio.crs import CRS

    wkt = crs.to_wkt(version="WKT2_2019")
    if not wkt.startswith("COMPOUNDCRS"):
        return crs
    begin = wkt.index(",", wkt.index('"', wkt.index('"') + 1)) + 1
    depth = 0
    for i in range(begin, len(wkt)):
        depth += (wkt[i] == "[") - (wkt[i] == "]")
        if depth == 0 and wkt[i] == "]":
            return CRS.from_wkt(wkt[begin : i + 1])
    return crs


def _cell_m(cells: Smooth, centre_m: Floats) -> float:
    _, slope = cells.at(centre_m[None])
    return float(1 / np.sqrt(abs(np.linalg.det(slope[0]))))


def _middle(raster: Any, cells: Smooth, centre_m: Floats, metres: float) -> float:
    """About how high the ground is near the middle; zero where that is not known."""
    from rasterio.windows import Window

    column, row = np.round(cells.at(centre_m[None])[0][0]).astype(int)
    column, row = int(np.clip(column, 0, raster.width - 1)), int(np.clip(row, 0, raster.height - 1))
    value = raster.read(1, window=Window(column, row, 1, 1), masked=True)
    return 0.0 if value.mask.any() else float(value[0, 0]) * metres


def _window(
    raster: Any, path: Path, cells: Smooth, centre_m: Floats, half_m: float, around_m: Floats
) -> tuple[Floats, Floats]:
    """Heights in the model's unit (rows, columns), NaN where unknown; column and row of the first."""
    from rasterio.windows import Window

    side = np.linspace(-half_m, half_m, 9)
    corners = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2) + centre_m
    place = cells.at(corners)[0]
    low = np.maximum(np.floor(place.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(place.max(axis=0)).astype(int) + 2, [raster.width, raster.height])
    if (high - low < 2).any():
        raise InputFileError(
            where=str(path), seen=f"it lies elsewhere: nothing of it is within {half_m / 1000:.1f} km of the cameras",
            expected="a terrain model of the place of the flight", advice="check flight.origin and the model",
        )  # fmt: skip
    value = raster.read(1, window=Window(*low, *(high - low)), masked=True)
    scale, offset = raster.scales[0], raster.offsets[0]
    out = np.ma.filled(value.astype(np.float32), np.nan) * np.float32(scale) + np.float32(offset)
    if not np.isfinite(out).any():
        raise InputFileError(
            where=str(path), seen=f"no height within {half_m / 1000:.1f} km of the cameras, only voids",
            expected="a terrain model of the place of the flight", advice="check flight.origin and the model",
        )  # fmt: skip
    return np.asarray(out, dtype=np.float32), low.astype(float)
