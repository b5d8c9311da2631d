"""A folder -> a flight file that begins with what lies in it: paired, looked at, and where all is known, matched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calibration.foundation.errors import RunningFixError, WriteError
from calibration.foundation.files import write_whole
from calibration.foundation.progress import Progress, silent
from pipeline.flight import flight_of
from pipeline.records import Box
from pipeline.stages.drafting.folder import look_into
from pipeline.stages.drafting.pairing import DraftCamera, draft_cameras
from pipeline.stages.drafting.text import boxes_text, draft_text, unknown
from pipeline.stages.running.match import MatchRun, match_text, proposed

FILE = "flight.toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class Draft:
    """The flight file that was written, its cameras, how many boxes each video got, the match where one was made."""

    path: Path
    cameras: tuple[DraftCamera, ...]
    boxes: dict[str, int]
    match: MatchRun | None
    to_fill: tuple[str, ...]
    warnings: tuple[str, ...]


def draft_flight(folder: Path, path: Path | None = None, *, detect: bool = True, progress: Progress = silent) -> Draft:
    """Writes a flight file for what lies in `folder`: at `path`, else flight.toml in it. Nothing is asked.

    With `detect`, boxes are proposed around what moves in each video; where nothing about the cameras has to be filled
    in, they are tracked and matched too.

    Raises WriteError where the file exists, InputFileError where there is nothing to begin with.
    """
    target = path or folder / FILE
    if target.exists():
        raise WriteError(
            where=str(target),
            seen="a file of that name",
            expected="a free name: nothing of yours is written over",
            advice="move it away, or give -o another-name.toml",
        )
    found = look_into(folder)
    cameras = draft_cameras(found)
    text = draft_text(found, cameras, target)
    missing, warnings = unknown(found, cameras), list(found.notes)
    boxes = _boxes(text, target, warnings, progress) if detect else {}
    whole, match = text + boxes_text(boxes), None
    several = sum(camera.tracks is not None or bool(boxes.get(camera.name)) for camera in cameras) > 1
    if several and not missing and not any(camera.tracks is not None for camera in cameras):
        try:
            flight, guessed = flight_of(whole.encode(), target), [name for own in boxes.values() for name in own]
            match, whole = match_text(flight, whole, target.parent / "out", guessed=guessed, progress=progress)
        except RunningFixError as error:
            warnings.append(f"targets are not matched between the cameras: {error.where}: {error.seen}")
        else:
            warnings += match.warnings
    elif several:
        reason = "what has to be filled in" if missing else "the tables of detections"
        warnings.append(f"targets are not matched between the cameras yet: look at {reason}, then `runningfix match`")
    write_whole(target, whole)
    return Draft(
        path=target,
        cameras=cameras,
        boxes={name: len(own) for name, own in boxes.items()},
        match=match,
        to_fill=missing,
        warnings=tuple(warnings),
    )


def _boxes(text: str, path: Path, warnings: list[str], progress: Progress) -> dict[str, dict[str, Box]]:
    """Boxes by camera around what moves in each video that has no table of detections."""
    found: dict[str, dict[str, Box]] = {}
    for camera in flight_of(text.encode(), path).cameras:
        if camera.video is None or camera.tracks is not None:
            continue
        try:
            found[camera.name] = proposed(camera, progress)
        except RunningFixError as error:
            warnings.append(f"{camera.name}: {error.seen}")
            continue
        if not found[camera.name]:
            warnings.append(f"{camera.name}: nothing that moves on its own was found; draw boxes with `label`")
    return found
