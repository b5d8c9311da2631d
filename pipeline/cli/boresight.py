"""`runningfix boresight`: how the cameras really sit, and when their videos began, from a flight."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from typing import Any

from calibration.foundation.errors import UsageError
from calibration.foundation.files import write_whole
from pipeline.boresight.flight import Surveyed, boresight_document, boresights
from pipeline.cli.console import Console
from pipeline.flight import read_flight


def run(arguments: Namespace, console: Console) -> int:
    """Finds the boresights, writes `boresight.json`, prints the lines for the flight file."""
    begin = time.perf_counter()
    surveyed = _surveyed(arguments)
    found = boresights(read_flight(arguments.flight), arguments.output, surveyed, progress=console.progress)
    against = "the solved flight" if surveyed is None else f"{surveyed.target}, surveyed"
    document = boresight_document(found, against)
    path = arguments.output / "boresight.json"
    write_whole(path, json.dumps(document, indent=1, allow_nan=False) + "\n")
    for camera in found:
        if camera.found.misfit > 1.3:
            console.say(
                f"note: {camera.camera}: residuals are {camera.found.misfit:.1f} times what the sigmas of the flight "
                "file explain; the covariance was enlarged by that"
            )
    seconds = round(time.perf_counter() - begin, 3)
    summary = {"status": "done", "command": "boresight", **document, "seconds": {"boresight": seconds}}
    console.result({**summary, "files": [str(path)]}, words(document))
    return 0


def _surveyed(arguments: Namespace) -> Surveyed | None:
    if (arguments.still is None) != (arguments.at is None):
        raise UsageError(
            where="--still and --at",
            seen="one without the other",
            expected="both, or neither for the trajectories of a solved flight",
            advice="--still mast --at 28.2001 112.9003 61.5",
        )
    if arguments.still is None:
        return None
    latitude, longitude, height = arguments.at
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise UsageError(
            where="--at",
            seen=f"{latitude:g} {longitude:g}",
            expected="latitude and longitude in degrees, height in metres above the ellipsoid",
            advice="--at 28.2001 112.9003 61.5",
        )
    return Surveyed(
        target=arguments.still,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        sigma_m=arguments.at_sigma_m,
    )


def words(document: dict[str, Any]) -> str:
    """The same for people: lines for the flight file, with what they are worth."""
    lines = []
    for name, camera in document["cameras"].items():
        key = next(k for k in ("mount", "mount_correction", "correction") if k in camera)
        angles = ", ".join(f"{axis} = {value:.3f}" for axis, value in camera[key].items())
        worth = ", ".join(f"{sigma:.3f}" for sigma in camera["sigma_deg"])
        lines += [f"[cameras.{name}]", f"{key} = {{ {angles} }}   # +- {worth}"]
        if camera["start_shift_s"] is not None:
            shift, sigma = camera["start_shift_s"], camera["start_shift_sigma_s"]
            start = "" if camera["start"] is None else f"start = {camera['start']:.4f}   "
            lines.append(f"{start}# the start moves by {shift:+.4f} +- {sigma:.4f} s")
    return "\n".join(lines)
