"""A draft of a flight file as text: every line that was guessed says so, and by what."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.records import Box
from pipeline.stages.drafting.folder import Found
from pipeline.stages.drafting.pairing import DraftCamera
from pipeline.telemetry import inspect_log

GUESSED = "# GUESSED"
TO_FILL = "# FILL IN"


def draft_text(found: Found, cameras: Sequence[DraftCamera], flight: Path) -> str:
    """The cameras of a flight file at `flight`; lines after GUESSED and FILL IN want a look."""
    lines = [
        f"# A draft of what lies in {found.folder.resolve().name}/, made by `runningfix new`.",
        f"# Lines marked {GUESSED[2:]} were chosen by what is said there, lines marked {TO_FILL[2:]} are not known:",
        "# look at them, then `runningfix check`, then `runningfix run`.",
        *(f"# {note}" for note in found.notes),
        "",
        "[flight]",
        f"reference_camera = {_text(cameras[0].name)}   {GUESSED}: the first; its clock is common time",
    ]
    for camera in cameras:
        lines += ["", *_camera(found, camera, flight)]
    return "\n".join(lines) + "\n"


def unknown(found: Found, cameras: Sequence[DraftCamera]) -> tuple[str, ...]:
    """What has to be filled in before positions can be computed, a sentence each."""
    missing = []
    for camera in cameras:
        if camera.calibration.path is None:
            missing.append(f"{camera.name}: no camera file; make one with `runningfix calibrate`")
        if camera.log.path is None:
            missing.append(f"{camera.name}: no log; name its telemetry, or its pose if it stands still")
        elif _mount_unknown(found, camera.log.path):
            missing.append(f"{camera.name}: how the camera is mounted (mount), which its log does not tell")
    return tuple(missing)


def _mount_unknown(found: Found, path: Path) -> bool:
    log = found.logs[path]
    return log is not None and any(line.startswith("mount = {") for line in inspect_log(log).flight_file)


def _camera(found: Found, camera: DraftCamera, flight: Path) -> list[str]:
    lines = [f"[cameras.{camera.name}]"]
    if camera.calibration.path is None:
        made = f"{camera.name}.json"
        lines.append(f"calibration = {_text(made)}   {TO_FILL}: `runningfix calibrate PHOTOS ... -o {made}`")
    else:
        lines.append(_line("calibration", camera.calibration.path, camera.calibration.guess, flight))
    if camera.video is not None:
        lines.append(_line("video", camera.video, "", flight))
    if camera.tracks is not None:
        lines.append(_line("tracks", camera.tracks, "", flight))
    if camera.log.path is None:
        lines.append(f'# telemetry = "{camera.name}.tlog"   {TO_FILL}: its log; or for a camera that stands still:')
        lines.append("# pose = { east_m = 0, north_m = 0, up_m = 2, yaw_deg = 0, pitch_deg = 0, roll_deg = 0 }")
        return lines
    lines.append(_line("telemetry", camera.log.path, camera.log.guess, flight))
    log = found.logs[camera.log.path]
    if log is None:
        return lines
    for line in inspect_log(log).flight_file:
        if line.startswith(("telemetry", "video")):
            continue
        mark = GUESSED if line.startswith(("start", 'mount = "gimbal"', "system", "gimbal")) else TO_FILL
        code, _, said = line.partition("   # ")
        lines.append(line if line.startswith("#") else f"{code}   {mark}" + (f": {said}" if said else ""))
    return lines


def boxes_text(boxes: Mapping[str, Mapping[str, Box]]) -> str:
    """Targets, each seen by one camera: `boxes` by camera, then name."""
    tables = [
        f"\n[targets.{name}]   {GUESSED}: it moves\nboxes.{camera} = "
        f"{{ frame = {box.frame}, box = [{box.x:g}, {box.y:g}, {box.width:g}, {box.height:g}] }}\n"
        for camera, own in boxes.items() for name, box in own.items()
    ]  # fmt: skip
    return "".join(tables)


def _line(key: str, path: Path, guess: str, flight: Path) -> str:
    try:
        shown = path.resolve().relative_to(flight.resolve().parent)
    except ValueError:
        shown = path.resolve()
    return f"{key} = {_text(str(shown))}" + (f"   {GUESSED}: {guess}" if guess else "")


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
