"""`runningfix new`: a folder of videos, logs and camera files -> a commented flight file."""

from __future__ import annotations

import time
from argparse import Namespace
from typing import Any

from pipeline.cli.console import Console
from pipeline.stages import Draft, draft_flight


def run(arguments: Namespace, console: Console) -> int:
    """Writes the draft and says what was chosen and what has to be filled in. Nothing is asked."""
    begin = time.perf_counter()
    found = draft_flight(arguments.folder, arguments.output, detect=not arguments.no_detect, progress=console.progress)
    for warning in found.warnings:
        console.say(f"note: {warning}")
    console.result(summary(found, time.perf_counter() - begin), words(found))
    return 0


def summary(found: Draft, seconds: float) -> dict[str, Any]:
    """The summary that `--json` prints."""
    return {
        "status": "done",
        "command": "new",
        "cameras": [
            {
                "name": c.name, "video": _text(c.video), "tracks": _text(c.tracks), "telemetry": _text(c.log.path),
                "telemetry_guessed_by": c.log.guess or None, "calibration": _text(c.calibration.path),
                "calibration_guessed_by": c.calibration.guess or None, "boxes": found.boxes.get(c.name, 0),
            }
            for c in found.cameras
        ],
        "matched_pairs": None if found.match is None else len(found.match.matching.pairs),
        "fill_in": list(found.to_fill),
        "warnings": list(found.warnings),
        "seconds": {"new": round(seconds, 3)},
        "files": [str(found.path)],
    }  # fmt: skip


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def words(found: Draft) -> str:
    """The same for people."""
    lines = []
    for camera in found.cameras:
        parts = [
            camera.video.name if camera.video else camera.tracks.name if camera.tracks else "",
            "no log" if camera.log.path is None else camera.log.path.name + _by(camera.log.guess),
            "no camera file"
            if camera.calibration.path is None
            else camera.calibration.path.name + _by(camera.calibration.guess),
        ]
        boxes = f", {found.boxes[camera.name]} boxes" if camera.name in found.boxes else ""
        lines.append(f"camera    {camera.name}: {', '.join(parts)}{boxes}")
    if found.match is not None:
        common = sum(len(target.tracks) > 1 for target in found.match.matching.targets)
        lines.append(
            f"matched   {common} targets common to cameras, {len(found.match.matching.doubtful)} doubtful pairs"
        )
    lines += [f"fill in   {line}" for line in found.to_fill]
    lines.append(f"wrote     {found.path}")
    lines.append(f"next      look at it, then `runningfix check {found.path}`")
    return "\n".join(lines)


def _by(guess: str) -> str:
    return f" (guessed: {guess})" if guess else ""
