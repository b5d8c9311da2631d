"""Every stage in a line: files in, files and a record that shows itself out."""

from __future__ import annotations

import glob
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from calibration import Board, calibrate_files, write_camera
from calibration.foundation.errors import InputFileError, UsageError
from calibration.foundation.progress import Progress
from pipeline.flight import Flight, read_flight
from pipeline.records.problem import METHODS
from pipeline.stages import check_flight, record_flight, run_flight, run_poses, run_solve, run_track
from pipeline.telemetry import read_log as read_flight_log
from runningfix.progress import bars
from runningfix.records import Calibrated, Doubts, Log, Poses, Result, Tracks

Named = str | Path
FlightNamed = Flight | Named


def calibrate(
    photos: Named | Iterable[Named],
    *,
    board: str = "9x6",
    square_mm: float = 25.0,
    marker_mm: float | None = None,
    dictionary: str = "",
    terms: str = "auto",
    output: Named | None = None,
    progress: Progress | None = None,
) -> Calibrated:
    """A camera from photos of a board, a folder of them, a pattern such as "board/*.jpg", or a video.

    board      inner corners as COLSxROWS; with `marker_mm` a ChArUco board
    square_mm  side of one square
    output     camera file to write
    Raises RunningFixError where photos are wrong or cannot determine the camera.
    """
    pattern = Board.parse(board, square_mm=square_mm, marker_mm=marker_mm, dictionary=dictionary)
    with bars(progress) as tell:
        found = calibrate_files(
            _files(photos), pattern, progress=lambda done, of: tell("photos", done, of), terms=terms
        )
    if output is not None:
        write_camera(Path(output), found.camera)
    return Calibrated(calibration=found)


def read_log(path: Named, *, system: int | None = None, gimbal: int | None = None) -> Log:
    """A flight log of any format: .tlog .bin .log .ulg .srt; `system` and `gimbal` pick one of several.

    Raises RunningFixError where it is no log.
    """
    return Log(log=read_flight_log(Path(path), system=system, gimbal=gimbal))


def check(flight: FlightNamed, *, progress: Progress | None = None) -> Doubts:
    """All that can be seen of a flight before tracking: what stops it, what is doubtful, what it can be worth.

    Raises RunningFixError where a file is missing.
    """
    with bars(progress) as tell:
        return Doubts(outlook=check_flight(_flight(flight), tell))


def track(flight: FlightNamed, out: Named = "out", *, progress: Progress | None = None) -> Tracks:
    """Follows the targets in the videos, what is finished left as it is; `tracks.csv` in `out`.

    Raises RunningFixError.
    """
    with bars(progress) as tell:
        summary = run_track(_flight(flight), Path(out), resume=True, progress=tell)
    return Tracks(folder=Path(out), warnings=summary.warnings)


def poses(flight: FlightNamed, out: Named = "out", *, progress: Progress | None = None) -> Poses:
    """Where every camera was and how it was turned, from the logs; `poses.csv` in `out`. Raises RunningFixError."""
    with bars(progress) as tell:
        summary = run_poses(_flight(flight), Path(out), progress=tell)
    return Poses(folder=Path(out), warnings=summary.warnings)


def solve(
    flight: FlightNamed, out: Named = "out", *, method: str | None = None, progress: Progress | None = None
) -> Result:
    """Trajectories, offsets and their sigmas from tracks and poses; all files of a result in `out`.

    `method` other than the flight file's: see the documentation of `[solve]`. Raises RunningFixError.
    """
    asked = _with_method(_flight(flight), method)
    with bars(progress) as tell:
        run_solve(asked, Path(out), progress=tell)
    return open_results(out)


def run(
    flight: FlightNamed, out: Named = "out", *, method: str | None = None, progress: Progress | None = None
) -> Result:
    """All stages; what is finished is not done again. Raises RunningFixError."""
    asked = _with_method(_flight(flight), method)
    with bars(progress) as tell:
        run_flight(asked, Path(out), progress=tell)
    return open_results(out)


def open_results(out: Named = "out") -> Result:
    """What a run left in a folder. Raises InputFileError where there is no result."""
    if not (Path(out) / "solution.json").is_file():
        raise InputFileError(
            where=str(out),
            seen="no solution.json",
            expected="the folder of a finished `run` or `solve`",
            advice="give the -o folder of that command",
        )
    return Result(folder=Path(out))


def to_rerun(flight: FlightNamed, out: Named = "out", to: Named | None = None, *, videos: bool = True) -> Path:
    """What a finished run left in `out` as a recording of the Rerun viewer; the file. Raises RunningFixError."""
    asked = _flight(flight)
    return record_flight(asked, Path(out), Path(to or Path(out) / f"{asked.path.stem}.rrd"), videos=videos).file


def _flight(asked: FlightNamed) -> Flight:
    return asked if isinstance(asked, Flight) else read_flight(Path(asked))


def _with_method(flight: Flight, method: str | None) -> Flight:
    if method is None:
        return flight
    for known in METHODS:
        if known == method:
            return replace(flight, solve=replace(flight.solve, method=known))
    raise UsageError(where="method", seen=repr(method), expected=f"one of {', '.join(METHODS)}", advice='method="map"')


def _files(given: Named | Iterable[Named]) -> list[Path]:
    """Each name as a path, a pattern as the paths that it stands for."""
    names = [given] if isinstance(given, str | Path) else list(given)
    found: list[Path] = []
    for name in names:
        here = Path(name)
        matches = [] if here.exists() else sorted(glob.glob(str(name), recursive=True))
        found += [Path(match) for match in matches] or [here]
    return found
