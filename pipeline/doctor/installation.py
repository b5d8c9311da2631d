"""What is installed, and what of it stands in the way.

Packages of one library under several names overwrite each other's files (OpenCV has four); which of them is loaded
is chance. Extras that are absent are no fault: what each would bring is told.
"""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from pipeline.solver import how_compiled

OPENCV = ("opencv-python", "opencv-python-headless", "opencv-contrib-python", "opencv-contrib-python-headless")
OURS = "opencv-contrib-python-headless"
NEEDED = ("numpy", "scipy", "pandas", OURS, "pymavlink", "rich", "pyyaml", "pillow", "av")
EXTRAS: Mapping[str, tuple[str, str]] = {
    "fast": ("numba", "compiled kernels; without them a solve takes several times as long"),
    "ulog": ("pyulog", "PX4 .ulg logs"),
    "parquet": ("pyarrow", "pose tables as .parquet"),
    "geoid": ("pyproj", "heights above sea level by EGM2008"),
    "terrain": ("rasterio", "terrain models under targets"),
    "plot": ("matplotlib", "plot() of the Python records"),
    "rerun": ("rerun-sdk", "recordings of the Rerun viewer"),
    "batch": ("fsspec", "many flights into one data set"),
    "demo": ("imageio-ffmpeg", "an encoder for rendered videos"),
    "cluster": ("distributed", "many flights on a Dask cluster"),
}
"""Extra -> the package that shows whether it is there, and what it brings."""

State = Literal["good", "absent", "wrong"]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that was looked at: `wrong` stands in the way, `absent` is only not there."""

    name: str
    state: State
    seen: str
    advice: str = ""


def findings() -> tuple[Finding, ...]:
    """Everything about this machine that decides whether the commands work."""
    installed = versions()
    return (
        machine(),
        *needed(installed),
        one_opencv(installed),
        opencv_builds(),
        *extras(installed),
        compiled_loops(how_compiled()),
        *writable(),
    )


def versions() -> Mapping[str, str]:
    """Version of every installed package by its normalised name."""
    return {
        str(one.metadata["Name"]).lower().replace("_", "-"): one.version
        for one in metadata.distributions()
        if one.metadata["Name"]
    }


def machine() -> Finding:
    """Python, system and processors."""
    seen = (
        f"Python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} processors"
    )
    return Finding(name="machine", state="good", seen=seen)


def needed(installed: Mapping[str, str]) -> Iterable[Finding]:
    """The packages without which nothing works."""
    for name in NEEDED:
        if name in installed:
            yield Finding(name=name, state="good", seen=installed[name])
        else:
            yield Finding(name=name, state="wrong", seen="not installed", advice=f"pip install {name}")


def one_opencv(installed: Mapping[str, str]) -> Finding:
    """Whether the one OpenCV package is the only one."""
    found = [name for name in OPENCV if name in installed]
    seen = ", ".join(f"{name} {installed[name]}" for name in found) or "none"
    if found == [OURS]:
        return Finding(name="one OpenCV", state="good", seen=seen)
    again = f"pip uninstall -y {' '.join(found)}; " if found else ""
    return Finding(
        name="one OpenCV",
        state="wrong",
        seen=f"{seen}; packages of OpenCV overwrite each other's files",
        advice=f"{again}pip install --force-reinstall --no-deps '{OURS}>=5,<6'",
    )


def opencv_builds() -> Finding:
    """Whether the OpenCV that is loaded has the tracker, and FFmpeg for videos."""
    name = "OpenCV's parts"
    try:
        import cv2
    except Exception as error:  # whatever a broken binary raises
        return Finding(name=name, state="wrong", seen=f"import cv2: {error}", advice=f"pip install '{OURS}>=5,<6'")
    lacks = [
        of for of, there in (("TrackerKCF", hasattr(cv2, "TrackerKCF")), ("FFmpeg", _reads_by_ffmpeg(cv2))) if not there
    ]
    if lacks:
        seen = f"{cv2.__version__} at {Path(cv2.__file__).parent}, without {' and '.join(lacks)}"
        return Finding(name=name, state="wrong", seen=seen, advice=f"pip install --force-reinstall '{OURS}>=5,<6'")
    return Finding(name=name, state="good", seen=f"{cv2.__version__} with TrackerKCF and FFmpeg")


def _reads_by_ffmpeg(cv2: object) -> bool:
    registry = cv2.videoio_registry  # type: ignore[attr-defined]
    return any(registry.getBackendName(one) == "FFMPEG" for one in registry.getBackends())


def extras(installed: Mapping[str, str]) -> Iterable[Finding]:
    """What is there beyond the needed, and what the rest would bring."""
    for extra, (package, brings) in EXTRAS.items():
        name = f"extra {extra}"
        if package in installed:
            yield Finding(name=name, state="good", seen=f"{package} {installed[package]}")
        else:
            yield Finding(name=name, state="absent", seen=brings, advice=f"pip install 'runningfix[{extra}]'")


def compiled_loops(how: str) -> Finding:
    """How the solver's loops run: built with the installation, compiled on first use, or not compiled."""
    if how == "ahead":
        return Finding(name="solver's loops", state="good", seen="compiled with the installation")
    if how == "when called":
        seen = "compiled on first use, about a minute once on a machine"
        return Finding(name="solver's loops", state="good", seen=seen, advice="runningfix doctor --warm does it ahead")
    advice = "install a C compiler and install again, or pip install 'runningfix[fast]'"
    return Finding(name="solver's loops", state="absent", seen="not compiled: about 20 times slower", advice=advice)


def writable() -> Iterable[Finding]:
    """The folders that are written without being asked for: temporary files and compiled code."""
    folder = Path(tempfile.gettempdir())
    if _can_write(folder):
        yield Finding(name="temporary files", state="good", seen=str(folder))
    else:
        advice = "set TMPDIR to a folder that can be written"
        yield Finding(name="temporary files", state="wrong", seen=f"{folder} cannot be written", advice=advice)
    kept = code_folder()
    if kept is not None:
        yield Finding(name="compiled code", state="good", seen=f"kept in {kept}")
    else:
        yield Finding(
            name="compiled code",
            state="absent",
            seen="no folder to keep it in: every process compiles for itself",
            advice="set NUMBA_CACHE_DIR to a folder that can be written",
        )


def code_folder() -> Path | None:
    """Where compiled code is kept: NUMBA_CACHE_DIR, else beside the source, else the user's cache; None: nowhere."""
    told = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(__file__).parents[1]
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser()
    for folder in [Path(told)] if told else [beside, cache]:
        if _can_write(folder):
            return folder
    return None


def _can_write(folder: Path) -> bool:
    """Whether a file can be made there, or in the nearest folder above that exists."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
