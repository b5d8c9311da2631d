"""Which files a solved flight leaves, one exporter each; and the edge that writes them.

tracks.csv and poses.csv are not among them: the stages before `solve` own those.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calibration.foundation.errors import WriteError
from calibration.foundation.files import write_whole
from pipeline.export.as_json import solution_json
from pipeline.export.as_tum import tum, tum_of_others
from pipeline.export.maps.as_czml import czml
from pipeline.export.maps.as_geojson import geojson
from pipeline.export.maps.as_geopackage import geopackage
from pipeline.export.maps.as_gpx import gpx
from pipeline.export.maps.as_kml import kml
from pipeline.export.maps.as_waypoints import waypoints, waypoints_of_others
from pipeline.export.tables.as_geoparquet import NO_PYARROW, geoparquet
from pipeline.export.tables.as_tables import clock_csv, sightings_csv, timing_csv, trajectory_csv
from pipeline.records import Results

NO_ORIGIN = "the flight is on no map: no log knows where it was; give origin = { lat, lon, height } under [flight]"
NO_TARGET = "no target has a trajectory"


@dataclass(frozen=True, kw_only=True)
class Exporter:
    """One file of a run.

    file_name  in the output folder
    content    from the results; None where there is nothing to tell
    absent     why there may be nothing, in words
    on_map     whether it needs the flight's origin
    """

    file_name: str
    content: Callable[[Results], str | bytes | None]
    absent: str = ""
    on_map: bool = False


EXPORTS: tuple[Exporter, ...] = (
    Exporter(file_name="timing.csv", content=timing_csv),
    Exporter(file_name="clock.csv", content=clock_csv, absent="no clock drifts"),
    Exporter(file_name="trajectory.csv", content=trajectory_csv),
    Exporter(file_name="sightings.csv", content=sightings_csv),
    Exporter(file_name="solution.json", content=solution_json),
    Exporter(file_name="trajectory.geojson", content=geojson, on_map=True),
    Exporter(file_name="trajectory.kml", content=kml, on_map=True),
    Exporter(file_name="trajectory.czml", content=czml, on_map=True),
    Exporter(file_name="trajectory.gpx", content=gpx, on_map=True),
    Exporter(file_name="trajectory.gpkg", content=geopackage, on_map=True),
    Exporter(file_name="trajectory.parquet", content=geoparquet, absent=f"no target has a trajectory, or {NO_PYARROW}"),
    Exporter(file_name="trajectory.waypoints", content=waypoints, on_map=True, absent=NO_TARGET),
    Exporter(file_name="trajectory.tum", content=tum, absent=NO_TARGET),
)
"""Every file that `solve` leaves, but for poses.csv and report.html."""


def export_all(results: Results) -> dict[str, str | bytes]:
    """File name -> content of all that the results have; the map formats only where there is an origin."""
    files: dict[str, str | bytes] = {}
    for exporter in EXPORTS:
        content = None if _off_map(exporter, results) else exporter.content(results)
        if content is not None:
            files[exporter.file_name] = content
    others = {} if results.origin is None else waypoints_of_others(results)
    return {**files, **tum_of_others(results), **others}


def not_exported(results: Results) -> dict[str, str]:
    """File name -> why it is missing, in words, for every exporter that `export_all` left out."""
    reasons: dict[str, str] = {}
    for exporter in EXPORTS:
        if _off_map(exporter, results):
            reasons[exporter.file_name] = NO_ORIGIN
        elif exporter.absent and exporter.content(results) is None:
            reasons[exporter.file_name] = exporter.absent
    return reasons


def write_exports(results: Results, folder: Path) -> tuple[Path, ...]:
    """Write `export_all` into `folder`, each file whole or not at all; returns the files written.

    What an earlier run left there of the files in `not_exported` is taken away: it would belong to another answer.

    Raises WriteError where the folder cannot be written.
    """
    written = []
    for name, content in export_all(results).items():
        write_whole(folder / name, content)
        written.append(folder / name)
    for name in not_exported(results):
        _remove(folder / name)
    return tuple(written)


def _off_map(exporter: Exporter, results: Results) -> bool:
    return exporter.on_map and results.origin is None


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(
            where=str(path),
            seen=f"an older result that cannot be removed ({error.strerror})",
            expected="a writable folder",
            advice="choose another -o folder",
        ) from None
