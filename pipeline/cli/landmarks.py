"""`runningfix landmarks`: a list of surveyed points becomes landmarks of a flight file."""

from __future__ import annotations

import time
from argparse import Namespace
from typing import Any

from pipeline.cli.console import Console
from pipeline.flight import read_flight
from pipeline.stages import LandmarkDraft, LandmarkOptions, draft_landmarks

ORDER = {None: None, "east-first": True, "north-first": False}
PIXEL = {None: None, "corner": True, "centre": False}


def run(arguments: Namespace, console: Console) -> int:
    """Writes the new flight file and says which points are seen where."""
    begin = time.perf_counter()
    flight = read_flight(arguments.flight)
    options = LandmarkOptions(
        coordinates=arguments.coordinates,
        system=arguments.crs,
        datum=arguments.datum,
        east_first=ORDER[arguments.order],
        corner=PIXEL[arguments.pixel_origin],
        first_frame=arguments.first_frame,
        sigma_m=arguments.sigma_m,
        sigma_up_m=arguments.sigma_up_m,
        sigma_px=arguments.sigma_px,
        check=tuple(arguments.check or ()),
    )
    found = draft_landmarks(flight, arguments.list, options, arguments.write)
    for warning in found.warnings:
        console.say(f"note: {warning}")
    console.result(summary(found, time.perf_counter() - begin), words(found))
    return 0


def summary(found: LandmarkDraft, seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    return {
        "status": "done",
        "command": "landmarks",
        "landmarks": [{"name": name, "marks": dict(by)} for name, by in found.marks.items()],
        "system": found.system,
        "datum": found.datum,
        "warnings": list(found.warnings),
        "seconds": {"landmarks": round(seconds, 3)},
        "files": [str(found.path)],
    }


def words(found: LandmarkDraft) -> str:
    """The same for people."""
    above = "the ellipsoid" if found.datum == "ellipsoid" else "mean sea level"
    lines = [f"{len(found.marks)} surveyed points, from {found.system}, heights above {above}"]
    for name, by in found.marks.items():
        lines.append(f"  {name}  " + ", ".join(f"{count} in {camera}" for camera, count in by.items()))
    return "\n".join([*lines, f"wrote     {found.path}"])
