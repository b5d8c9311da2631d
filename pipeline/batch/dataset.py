"""The data set: `catalogue.parquet`, a row a flight, and `trajectory/flight=NAME/trajectory.parquet`, GeoParquet.

    duckdb  SELECT verdict, count(*) FROM 'batch/catalogue.parquet' GROUP BY verdict
    duckdb  SELECT * FROM read_parquet('batch/trajectory/*/*.parquet', hive_partitioning = true)
    pandas  pd.read_parquet("batch/trajectory")

Geometry is the point of each row, longitude and latitude in degrees (OGC:CRS84) and height in metres above the WGS84
ellipsoid; null where a flight is on no map.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibration.foundation.errors import UsageError
from pipeline.batch.outcome import FlightOutcome
from pipeline.export import parquet_bytes, parquet_of


def arrow() -> Any:
    """The package that writes Parquet. Raises UsageError where it is not installed."""
    try:
        import pyarrow.parquet
    except ImportError:
        raise UsageError(
            where="runningfix batch", seen="the package 'pyarrow' is not installed", expected="it, to write Parquet",
            advice="pip install 'runningfix[batch]'",
        ) from None  # fmt: skip
    return pyarrow


def trajectory_parquet(table: Path) -> bytes:
    """A `trajectory.csv` as GeoParquet: the same columns, `utc` as a time, and the point of each row."""
    arrow()
    return parquet_of(table.read_text(encoding="utf-8"))


def catalogue_parquet(outcomes: Sequence[FlightOutcome]) -> bytes:
    """A row for each flight, in order of their names; offsets and positions are lists of structs."""
    pa = arrow()
    offset = pa.struct([("camera", pa.string()), ("offset_s", pa.float64()), ("offset_sigma_s", pa.float64())])
    position = pa.struct([("target", pa.string()), ("typical_sigma_m", pa.float64())])
    texts, mapping = pa.list_(pa.string()), pa.map_(pa.string(), pa.string())
    schema = pa.schema([
        ("flight", pa.string()), ("source", pa.string()), ("status", pa.string()), ("verdict", pa.string()),
        ("reasons", texts), ("method", pa.string()), ("offsets", pa.list_(offset)), ("positions", pa.list_(position)),
        ("worst_offset_sigma_s", pa.float64()), ("worst_position_sigma_m", pa.float64()), ("chi_square", pa.float64()),
        ("degrees_of_freedom", pa.int64()), ("seconds", pa.float64()), ("solver_seconds", pa.float64()),
        ("exit_code", pa.int32()), ("error", pa.string()), ("advice", pa.string()), ("warnings", texts),
        ("versions", mapping),
    ])  # fmt: skip
    rows = [_row(outcome) for outcome in sorted(outcomes, key=lambda o: o.name)]
    return parquet_bytes(pa.Table.from_pylist(rows, schema=schema))


def _row(o: FlightOutcome) -> dict[str, Any]:
    same = (
        "source", "status", "method", "chi_square", "degrees_of_freedom", "seconds", "solver_seconds", "exit_code"
    )  # fmt: skip
    return {
        **{name: getattr(o, name) for name in same},
        "flight": o.name,
        "verdict": o.verdict or None,
        "reasons": list(o.reasons),
        "offsets": [dict(offset) for offset in o.offsets],
        "positions": [dict(position) for position in o.positions],
        "worst_offset_sigma_s": worst(offset.get("offset_sigma_s") for offset in o.offsets),
        "worst_position_sigma_m": worst(position.get("typical_sigma_m") for position in o.positions),
        "error": said(o) or None,
        "advice": o.error.get("advice"),
        "warnings": list(o.warnings),
        "versions": sorted(o.versions.items()),
    }


def said(outcome: FlightOutcome) -> str:
    """What stopped a flight, in a line; "" where nothing did."""
    e = outcome.error
    return f"{e['where']}: {e['seen']}; expected {e['expected']}" if e else ""


def worst(values: Any) -> float | None:
    """The largest of sigmas; None where there is none, or one is unknown: then nothing bounds it."""
    known = list(values)
    return max(known) if known and all(value is not None for value in known) else None
