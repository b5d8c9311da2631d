"""trajectory.parquet: trajectory.csv as GeoParquet 1.1, for GeoPandas, DuckDB, QGIS; needs pyarrow.

Geometry is the point of each row, longitude and latitude in degrees (OGC:CRS84) and height in metres above the WGS84
ellipsoid; null where the flight is on no map.
"""

from __future__ import annotations

import io
import json
from importlib.util import find_spec
from typing import Any

import numpy as np

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
    import pandas as pd
    import pyarrow as pa

    rows = pd.read_csv(
        io.StringIO(trajectory), dtype={"target": str, "utc": str}, keep_default_na=False, na_values=[""]
    )
    columns: dict[str, Any] = {}
    for name in rows.columns:
        if name == "target":
            columns[name] = pa.array(rows[name].tolist(), pa.string())
        elif name == "utc":
            columns[name] = pa.array(pd.to_datetime(rows[name], utc=True), pa.timestamp("us", tz="UTC"))
        else:
            columns[name] = pa.array(rows[name].to_numpy(float), pa.float64(), from_pandas=True)
    place = rows[list(PLACE)].to_numpy(float) if set(PLACE) <= set(rows.columns) else np.full((len(rows), 3), np.nan)
    columns["geometry"] = pa.array(well_known_points(place), pa.binary())
    return parquet_bytes(pa.table(columns).replace_schema_metadata({b"geo": json.dumps(GEO).encode()}))


def parquet_bytes(table: Any) -> bytes:
    """The bytes of a Parquet file; the same table gives the same."""
    from pyarrow import parquet

    out = io.BytesIO()
    parquet.write_table(table, out, compression="zstd")
    return out.getvalue()
