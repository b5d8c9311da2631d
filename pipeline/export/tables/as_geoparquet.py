"""trajectory.parquet: trajectory.csv as GeoParquet 1.1, for GeoPandas, DuckDB, QGIS; needs pyarrow.

Geometry is the point of each row, longitude and latitude in degrees (OGC:CRS84) and height in metres above the WGS84
ellipsoid; null where the flight is on no map.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.export.tables.as_tables import trajectory_csv
from pipeline.export.text.well_known import well_known_points
from pipeline.records import Results

GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Point Z"]}},
}
PLACE = ("longitude_deg", "latitude_deg", "height_m")
NO_PYARROW = "pyarrow is not installed: pip install 'runningfix[parquet]'"


def geoparquet(results: Results) -> bytes | None:
    """The trajectories; None where pyarrow is missing or there is no target."""
    if find_spec("pyarrow") is None or not results.trajectories:
        return None
    return parquet_of(trajectory_csv(results))


def parquet_of(trajectory: str) -> bytes:
    """The text of a trajectory.csv: the same columns, `utc` as a time, and the point of each row."""
    import pyarrow as pa

    header, *rows = csv.reader(io.StringIO(trajectory))
    texts = dict(zip(header, zip(*rows, strict=True), strict=True)) if rows else dict.fromkeys(header, ())
    columns: dict[str, Any] = {}
    for name, column in texts.items():
        if name == "target":
            columns[name] = _bytes(pa.string(), [text.encode() for text in column])
        elif name == "utc":
            columns[name] = _plain(pa.timestamp("us", tz="UTC"), _times_us(column), np.array([c != "" for c in column]))
        else:
            value = _numbers(column)
            columns[name] = _plain(pa.float64(), value, ~np.isnan(value))
    place = np.full((len(rows), 3), np.nan)
    if set(PLACE) <= set(header):
        place = np.stack([_numbers(texts[name]) for name in PLACE], axis=1)
    columns["geometry"] = _bytes(pa.binary(), well_known_points(place))
    return parquet_bytes(pa.table(columns).replace_schema_metadata({b"geo": json.dumps(GEO).encode()}))


def _numbers(texts: Sequence[str]) -> Floats:
    return np.array([float(text) if text else np.nan for text in texts], dtype=float)


def _times_us(texts: Sequence[str]) -> Ints:
    """Microseconds since 1970, 0 where there is no time; the texts end in Z."""
    return np.array([text.rstrip("Z") or "1970-01-01" for text in texts], dtype="datetime64[us]").astype(np.int64)


def _plain(kind: Any, values: Floats | Ints, known: Bools) -> Any:
    """A column of 8-byte values, null where not known; made of its bytes, since `pa.array` would load pandas."""
    import pyarrow as pa

    return pa.Array.from_buffers(kind, len(values), [_known(known), pa.py_buffer(values.tobytes())])


def _bytes(kind: Any, values: Sequence[bytes | None]) -> Any:
    """The same of texts or bytes, null where None."""
    import pyarrow as pa

    ends = np.cumsum([0, *(len(v or b"") for v in values)]).astype(np.int32)
    parts = [_known(np.array([v is not None for v in values], dtype=bool)), pa.py_buffer(ends.tobytes())]
    return pa.Array.from_buffers(kind, len(values), [*parts, pa.py_buffer(b"".join(v or b"" for v in values))])


def _known(known: Bools) -> Any:
    """Which values of a column are there, a bit each; None: all."""
    import pyarrow as pa

    return None if known.all() else pa.py_buffer(np.packbits(known, bitorder="little").tobytes())


def parquet_bytes(table: Any) -> bytes:
    """The bytes of a Parquet file; the same table gives the same."""
    from pyarrow import parquet

    out = io.BytesIO()
    parquet.write_table(table, out, compression="zstd")
    return out.getvalue()
