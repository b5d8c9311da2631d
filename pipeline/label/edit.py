"""Boxes put into, and taken out of, the text of a flight file; every other character stays as it is.

The text is edited by lines and then read again: unless exactly the wanted box differs, the edit is refused. So an
unusual way of writing TOML can make an edit impossible, never wrong.
"""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

from calibration.foundation.errors import UsageError
from pipeline.records import Box

KEY = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
HEADER = re.compile(r"^\s*\[")
TARGET = re.compile(rf"^\s*\[\s*targets\s*\.\s*({KEY})\s*\]\s*(?:#.*)?$")
BOXES = re.compile(rf"^\s*\[\s*targets\s*\.\s*({KEY})\s*\.\s*boxes\s*\]\s*(?:#.*)?$")
BOX_LINE = re.compile(rf"^(\s*)(?:boxes\s*\.\s*)?({KEY})(\s*=\s*)(\{{[^}}]*\}})(.*)$", re.DOTALL)
IN_TARGET = re.compile(r"^\s*boxes\s*\.")


def with_box(text: str, target: str, camera: str, box: Box) -> str:
    """The flight file's text with this box of a target in a camera, in place of an earlier one.

    Raises UsageError where the file's way of writing boxes cannot be edited.
    """
    wanted = tomllib.loads(text)
    mine = wanted.setdefault("targets", {}).setdefault(target, {}).setdefault("boxes", {})
    mine[camera] = {"frame": box.frame, "box": [box.x, box.y, box.width, box.height]}
    lines = text.splitlines(keepends=True)
    at = _box_line(lines, target, camera)
    if at is not None:
        match = BOX_LINE.match(lines[at])
        assert match is not None
        key = lines[at][: match.start(4)]
        lines[at] = key + _value(box) + match.group(5)
    else:
        _insert(lines, target, camera, box, _newline(text))
    return _checked("".join(lines), wanted, f"targets.{target}.boxes.{camera}")


def without_box(text: str, target: str, camera: str) -> str:
    """The text without the box; a target's table that held nothing else goes with it.

    Raises UsageError where there is no such box, or it cannot be edited.
    """
    wanted = tomllib.loads(text)
    where = f"targets.{target}.boxes.{camera}"
    lines = text.splitlines(keepends=True)
    at = _box_line(lines, target, camera)
    if at is None or camera not in wanted.get("targets", {}).get(target, {}).get("boxes", {}):
        raise _cannot(where, "no box that stands on a line of its own")
    del lines[at]
    del wanted["targets"][target]["boxes"][camera]
    if not wanted["targets"][target]["boxes"]:
        del wanted["targets"][target]["boxes"]
    if not wanted["targets"][target]:
        _drop_empty(lines, target)
        del wanted["targets"][target]
    return _checked("".join(lines), wanted, where)


def boxes_swapped(text: str, camera: str, one: str, other: str) -> str:
    """The text with the boxes of two targets in one camera exchanged; either may have none there.

    Raises UsageError where they cannot be edited.
    """
    tables = tomllib.loads(text).get("targets", {})
    boxes = {name: tables.get(name, {}).get("boxes", {}).get(camera) for name in (one, other)}
    for name, source in ((one, boxes[other]), (other, boxes[one])):
        if source is not None:
            x, y, width, height = source["box"]
            text = with_box(text, name, camera, Box(frame=source["frame"], x=x, y=y, width=width, height=height))
        elif boxes[name] is not None:
            text = without_box(text, name, camera)
    return text


def _value(box: Box) -> str:
    sides = ", ".join(f"{side:.10g}" for side in (box.x, box.y, box.width, box.height))
    return f"{{ frame = {box.frame}, box = [{sides}] }}"


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _plain(key: str) -> str:
    """What a key says."""
    return str(next(iter(tomllib.loads(f"{key} = 0"))))


def _newline(text: str) -> str:
    return "\r\n" if "\r\n" in text else "\n"


def _section(lines: list[str], header: re.Pattern[str], target: str) -> range | None:
    """The lines after a target's header, up to the next one."""
    for start, line in enumerate(lines):
        match = header.match(line.rstrip("\r\n"))
        if match and _plain(match.group(1)) == target:
            end = next((k for k in range(start + 1, len(lines)) if HEADER.match(lines[k])), len(lines))
            return range(start + 1, end)
    return None


def _box_line(lines: list[str], target: str, camera: str) -> int | None:
    for header in (TARGET, BOXES):
        for at in _section(lines, header, target) or ():
            match = BOX_LINE.match(lines[at])
            named = bool(IN_TARGET.match(lines[at])) == (header is TARGET)
            if match and named and _plain(match.group(2)) == camera:
                return at
    return None


def _insert(lines: list[str], target: str, camera: str, box: Box, newline: str) -> None:
    """A new line where the target's other boxes are, or a new table at the file's end."""
    for header, prefix in ((BOXES, ""), (TARGET, "boxes.")):
        section = _section(lines, header, target)
        if section is not None:
            filled = [k for k in section if lines[k].strip() and not lines[k].lstrip().startswith("#")]
            at = filled[-1] + 1 if filled else section.start
            if not lines[at - 1].endswith("\n"):
                lines[at - 1] += newline
            lines.insert(at, f"{prefix}{_key(camera)} = {_value(box)}{newline}")
            return
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += newline
    head = "" if not lines or not lines[-1].strip() else newline
    lines.append(f"{head}[targets.{_key(target)}]{newline}boxes.{_key(camera)} = {_value(box)}{newline}")


def _drop_empty(lines: list[str], target: str) -> None:
    """Takes the header of a target that holds nothing any more, and the blank lines after it."""
    for header in (BOXES, TARGET):
        section = _section(lines, header, target)
        if section is not None and not any(lines[k].strip() for k in section):
            del lines[section.start - 1 : section.stop]


def _checked(text: str, wanted: dict[str, Any], where: str) -> str:
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        found = {}
    if found != wanted:
        raise _cannot(where, "boxes written in a way that is not edited here")
    return text


def _cannot(where: str, seen: str) -> UsageError:
    return UsageError(
        where=where,
        seen=seen,
        expected="boxes.NAME = { frame = ..., box = [x, y, width, height] } on a line of its own",
        advice="edit that part of the flight file by hand; it was left as it is",
    )
