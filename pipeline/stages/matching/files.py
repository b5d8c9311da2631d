"""A match as files: the flight file again with targets common to its cameras, and tables of tracks under their names.

Everything but targets and `tracks` stays as the user wrote it, comments too. The new text is read again: unless exactly
that differs, it is refused.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.foundation.errors import UsageError, WriteError
from pipeline.export import tracks_csv
from pipeline.flight import Flight
from pipeline.matching import TrackName
from pipeline.records import Box, ImageTrack

SUFFIX = "-matched"
HEADER = re.compile(r"^\s*\[")
TARGETS = re.compile(r"""^\s*\[\s*(?:targets|"targets"|'targets')\s*[.\]]""")
TRACKS_LINE = re.compile(r"^(\s*tracks\s*=\s*)(\"(?:[^\"\\]|\\.)*\"|'[^']*')(.*)$", re.DOTALL)


def matched_paths(flight: Flight, wanted: Path | None) -> dict[str, Path]:
    """Where the files of a match go: the flight file under "", tables by camera. Raises WriteError where one exists."""
    folder = flight.path.parent
    found = {"": wanted or folder / f"{flight.path.stem}{SUFFIX}.toml"}
    if found[""].resolve().parent != folder.resolve():
        raise WriteError(
            where=str(found[""]),
            seen="another folder than the flight file's",
            expected="a name in that folder, since paths in a flight file are relative to it",
            advice=f"--write {folder / found[''].name}",
        )
    for camera in flight.cameras:
        if camera.tracks is not None:
            found[camera.name] = folder / f"{camera.tracks.stem}{SUFFIX}.csv"
    for path in found.values():
        if path.exists():
            raise WriteError(
                where=str(path),
                seen="a file of that name",
                expected="a free name: nothing of yours is written over",
                advice="move it away" + ("" if path != found[""] else ", or give --write another-name.toml"),
            )
    return found


def matched_tables(
    tracks: Sequence[ImageTrack], names: Mapping[TrackName, str], paths: Mapping[str, Path]
) -> dict[Path, str]:
    """The tables of the cameras that have detections made elsewhere, targets under their common names."""
    found = {}
    for camera, path in paths.items():
        own = [
            replace(t, target=names.get(TrackName(camera=camera, target=t.target), t.target))
            for t in tracks if t.camera == camera
        ]  # fmt: skip
        if camera:
            found[path] = tracks_csv(own)
    return found


def matched_text(
    text: str,
    flight: Flight,
    boxes: Mapping[TrackName, Box],
    names: Mapping[TrackName, str],
    paths: Mapping[str, Path],
    notes: Mapping[str, Sequence[str]],
    dropped: Collection[str] = (),
) -> str:
    """The flight file `text` with its targets anew: `boxes` of tracks (the first of each) under their common `names`.

    Notes stand above them as comments; several boxes of a target stay several. Targets `dropped` are left out.

    Raises UsageError where the file writes its targets or tracks in a way that is not edited here.
    """
    before = tomllib.loads(text)
    wanted = copy.deepcopy(before)
    lines = _without_targets(text.splitlines(keepends=True))
    for camera, path in paths.items():
        if camera:
            wanted["cameras"][camera]["tracks"] = path.name
            lines = _with_tracks(lines, camera, path.name)
    wanted["targets"] = _tables({k: v for k, v in before.get("targets", {}).items() if k not in dropped}, boxes, names)
    if not wanted["targets"]:
        del wanted["targets"]
    newline = "\r\n" if "\r\n" in text else "\n"
    kept = "".join(lines).rstrip()
    new = kept + newline + "".join(
        newline + _table_text(name, table, notes.get(name, ()), newline)
        for name, table in wanted.get("targets", {}).items()
    )  # fmt: skip
    if _read(new) != wanted:
        raise UsageError(
            where=str(flight.path),
            seen="targets or tracks written in a way that is not edited here",
            expected='[targets.NAME] tables, and tracks = "..." on a line of its own',
            advice="write them so; the file was left as it is",
        )
    return new


def _read(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return {}


def _tables(
    given: Mapping[str, Any], boxes: Mapping[TrackName, Box], names: Mapping[TrackName, str]
) -> dict[str, dict[str, Any]]:
    """Targets by their common names: what was given of the first track's target, and boxes. Targets that no track is
    of stay as they are.
    """
    found: dict[str, dict[str, Any]] = {}
    for track, name in sorted(names.items(), key=lambda item: list(names).index(item[0])):
        table = found.setdefault(name, {})
        for key, value in given.get(track.target, {}).items():
            if key != "boxes" and (track in boxes or track.camera not in given[track.target].get("boxes", {})):
                table.setdefault(key, value)
        if track in boxes:
            box = boxes[track]
            made = {"frame": box.frame, "box": [box.x, box.y, box.width, box.height]}
            told = given.get(track.target, {}).get("boxes", {}).get(track.camera, made)  # one, or several
            table.setdefault("boxes", {})[track.camera] = copy.deepcopy(told)
    used = {track.target for track in names}
    for name, table in given.items():
        if name not in used and name not in found:
            found[name] = copy.deepcopy(table)
    return found


def _table_text(name: str, table: Mapping[str, Any], notes: Sequence[str], newline: str) -> str:
    lines = [*(f"# {note}" for note in notes), f"[targets.{_key(name)}]"]
    lines += [f"{_key(key)} = {_value(value)}" for key, value in table.items() if key != "boxes"]
    lines += [f"boxes.{_key(camera)} = {_value(box)}" for camera, box in table.get("boxes", {}).items()]
    return newline.join(lines) + newline


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: Any) -> str:
    """A TOML value in one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return f"{value!r}"


def _without_targets(lines: list[str]) -> list[str]:
    """The lines of every table but the targets'; comments right above a target's header go with it."""
    found: list[str] = []
    inside = False
    for line in lines:
        if HEADER.match(line):
            inside = bool(TARGETS.match(line))
            while inside and found and found[-1].lstrip().startswith("#"):
                found.pop()
        if not inside:
            found.append(line)
    return found


def _with_tracks(lines: list[str], camera: str, name: str) -> list[str]:
    """The lines with another table of tracks of a camera."""
    found, inside = [], False
    for line in lines:
        if HEADER.match(line):
            inside = _is_camera(line, camera)
        match = TRACKS_LINE.match(line) if inside else None
        found.append(line if match is None else match.group(1) + json.dumps(name, ensure_ascii=False) + match.group(3))
    return found


def _is_camera(line: str, camera: str) -> bool:
    try:
        return tomllib.loads(line) == {"cameras": {camera: {}}}
    except tomllib.TOMLDecodeError:
        return False
