"""3D trajectories of moving targets from unsynchronised flight video, flight logs and photos of a board.

    import runningfix as rf

    rf.calibrate("board/*.jpg", board="9x6", square_mm=25, output="uav1.json")   a camera from photos
    rf.read_log("uav1.tlog")               a flight log
    rf.check("flight.toml")                what is wrong or doubtful, before an hour of tracking
    rf.track("flight.toml", "out")         video -> tracks
    rf.poses("flight.toml", "out")         logs -> camera poses
    rf.solve("flight.toml", "out")         tracks and poses -> trajectories
    rf.run("flight.toml", "out")           all of it; what is finished is not done again
    rf.open_results("out")                 what an earlier run left
    rf.to_rerun("flight.toml", "out")      the same as a recording of the Rerun viewer (extra `rerun`)

Each returns a frozen record that shows itself: `to_dataframe()` is a pandas table with units in its column names,
`plot()` draws on matplotlib axes (extra `plot`) and returns them. A record holds what it was made of for those who want
more. Every sigma is one standard deviation. Errors are `rf.RunningFixError`: where, seen, expected, advice.

Where more is wanted than a line: `rf.read_flight`, and the packages that all of this is made of.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.camera_files import read_camera, write_camera
    from calibration.foundation.errors import RunningFixError
    from pipeline.flight import read_flight
    from runningfix.records import Calibrated, Doubts, Log, Poses, Result, Tracks
    from runningfix.stages import calibrate, check, open_results, poses, read_log, run, solve, to_rerun, track

__all__ = [
    "Calibrated",
    "Doubts",
    "Log",
    "Poses",
    "Result",
    "RunningFixError",
    "Tracks",
    "calibrate",
    "check",
    "open_results",
    "poses",
    "read_camera",
    "read_flight",
    "read_log",
    "run",
    "solve",
    "to_rerun",
    "track",
    "write_camera",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


def __getattr__(name: str) -> object:
    """Each name is loaded when it is first asked for, so that importing the package is quick."""
    if name == "__version__":
        try:
            return version("runningfix")
        except PackageNotFoundError:
            return "not installed"
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _load(name)


def _load(name: str) -> object:
    if name == "RunningFixError":
        from calibration.foundation.errors import RunningFixError

        return RunningFixError
    if name in ("read_camera", "write_camera"):
        from calibration import camera_files

        return getattr(camera_files, name)
    if name == "read_flight":
        from pipeline.flight import read_flight

        return read_flight
    return getattr(import_module(f"{__name__}.{'records' if name[0].isupper() else 'stages'}"), name)
