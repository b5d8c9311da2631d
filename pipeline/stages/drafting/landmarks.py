"""Lists of ground control points become `[landmarks]` tables of a flight file: pictures are frames of its cameras.

A picture's name begins with its camera: the video's name, with or without its ending, or the camera's own; the number
at its end is the frame's. The flight file is left as it is; a new one is written beside it, the tables at its end.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.foundation.errors import InputFileError, UsageError, WriteError
from calibration.foundation.files import read_bytes, write_whole
from pipeline.flight import CameraSettings, Flight, flight_of
from pipeline.survey import ControlList, ControlMark, ControlPoint, Places, places, read_list, with_coordinates

Seen = Mapping[str, Mapping[int, ControlMark]]
"""Marks of one point by camera and frame."""
SUFFIX = "-landmarks"
PICTURE_ENDINGS = r"\.(?:jpe?g|png|tiff?|bmp|webp|dng)$"


@dataclass(frozen=True, kw_only=True)
class LandmarkOptions:
    """How a list is read; None: as its kind has it, or as the list says.

    coordinates  Pix4D's other file
    system       its coordinate system, where the list has none
    datum        what heights count from
    east_first   which of two coordinates is first
    corner       pixels count from the corner of the top-left pixel
    first_frame  number in the name of a video's frame 0
    sigma_m, sigma_up_m, sigma_px  of places and marks, where the list has none
    check        points that are only held against the answer
    """

    coordinates: Path | None = None
    system: str | None = None
    datum: str | None = None
    east_first: bool | None = None
    corner: bool | None = None
    first_frame: int = 0
    sigma_m: float = 0.05
    sigma_up_m: float | None = None
    sigma_px: float = 1.0
    check: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class LandmarkDraft:
    """What was written: the file, marks by camera of every landmark, the system, and what is to be known about it."""

    path: Path
    marks: Mapping[str, Mapping[str, int]]
    system: str
    datum: str
    warnings: tuple[str, ...]


def draft_landmarks(flight: Flight, path: Path, options: LandmarkOptions, write: Path | None) -> LandmarkDraft:
    """Writes the flight file with the landmarks of the list at `path`.

    Raises UsageError, InputFileError and WriteError, each before anything is written.
    """
    target = _target(flight, write)
    found = _read(path, options)
    _check_options(found, options)
    seen, others = _by_frame(flight, found, options)
    points = [p for p in found.points if p.name in seen]
    _check_names(flight, list(seen), path)
    system = options.system or found.system
    if not system:
        raise UsageError(
            where=str(path), seen=f"a list of {found.kind}, which names no coordinate system", expected="--crs",
            advice="say --crs EPSG:32616, or which it is",
        )  # fmt: skip
    east_first = found.east_first if options.east_first is None else options.east_first
    where = str(options.coordinates or path)
    at = places(points, system, east_first=east_first, datum=options.datum, where=where)  # type: ignore[arg-type]
    old = read_bytes(flight.path, expected="a flight file (TOML)").decode("utf-8-sig")
    tables = [_table(point, at, k, seen[point.name], options) for k, point in enumerate(points)]
    text = "\n".join([old.rstrip("\n"), "", f"# surveyed points of {path.name}, {at.system}", *tables])
    flight_of(text.encode(), target)
    write_whole(target, text)
    unseen = [p.name for p in found.points if p.name not in seen]
    return LandmarkDraft(
        path=target, marks={name: {c: len(m) for c, m in by.items()} for name, by in seen.items()}, system=at.system,
        datum=at.datum, warnings=(*at.notes, *_warnings(others, unseen)),
    )  # fmt: skip


def _read(path: Path, options: LandmarkOptions) -> ControlList:
    found = read_list(path, corner=options.corner)
    if options.coordinates is not None and found.kind == "OpenDroneMap":
        raise UsageError(
            where="--coordinates", seen=f"{path}, which has its points' coordinates", expected="a list of marks only",
            advice="leave --coordinates out",
        )  # fmt: skip
    if options.coordinates is not None:
        return with_coordinates(found, options.coordinates)
    if found.kind == "Pix4D":
        raise UsageError(
            where=str(path), seen="marks without the coordinates of their points", expected="the other file of Pix4D",
            advice="say --coordinates gcps.csv",
        )  # fmt: skip
    return found


def _check_options(found: ControlList, options: LandmarkOptions) -> None:
    unknown = sorted(set(options.check) - {p.name for p in found.points})
    if unknown:
        raise UsageError(
            where="--check", seen=f'"{unknown[0]}"', expected="points of the list",
            advice="one of " + ", ".join(p.name for p in found.points[:20]),
        )  # fmt: skip


def _by_frame(
    flight: Flight, found: ControlList, options: LandmarkOptions
) -> tuple[dict[str, dict[str, dict[int, ControlMark]]], list[str]]:
    """Marks by point, camera and frame; and pictures of no camera. Raises InputFileError where all are."""
    seen: dict[str, dict[str, dict[int, ControlMark]]] = {}
    others: list[str] = []
    for mark in found.marks:
        where = f"{found.path}: line {mark.line}"
        place = frame_of(mark.picture, flight.cameras, options.first_frame, where)
        if place is None:
            others.append(mark.picture)
            continue
        camera, frame = place
        own = seen.setdefault(mark.point, {}).setdefault(camera, {})
        if frame in own:
            raise InputFileError(
                where=where, seen=f'"{mark.point}" in frame {frame} of {camera} again, as in line {own[frame].line}',
                expected="one mark a frame", advice="keep one of them",
            )  # fmt: skip
        own[frame] = mark
    if not seen:
        names = ", ".join(f"{_called(c)[0]}_000120.png" for c in flight.cameras)
        raise InputFileError(
            where=str(found.path), seen=f'pictures of no camera of the flight, such as "{others[0]}"',
            expected=f"names that begin with a camera's or its video's and end in the frame's number: {names}",
            advice="name the frames so when they are taken out of the videos",
        )  # fmt: skip
    return seen, sorted(set(others))


def frame_of(
    picture: str, cameras: Sequence[CameraSettings], first_frame: int, where: str
) -> tuple[str, int] | None:  # fmt: skip
    """Camera and frame of a picture by its name; None where it is of no camera.

    Raises InputFileError for a name that is a moving camera's without a number, or a number before the first.
    """
    stem = re.sub(PICTURE_ENDINGS, "", Path(picture.replace("\\", "/")).name, flags=re.IGNORECASE)
    fits = [(len(name), c, name) for c in cameras for name in _called(c) if _begins(stem, name)]
    if not fits:
        return None
    _, camera, name = max(fits, key=lambda fit: fit[0])
    digits = re.search(r"(\d{1,9})$", stem[len(name) :])
    if digits is None:
        if camera.pose is not None:
            return camera.name, 0
        raise InputFileError(
            where=where, seen=f'the picture "{picture}" without a frame\'s number, of {camera.name}, which moves',
            expected=f"{name}_000120.png for frame 120", advice="put the frame's number at the end of its name",
        )  # fmt: skip
    frame = int(digits.group(1)) - first_frame
    if frame < 0:
        raise InputFileError(
            where=where, seen=f'"{picture}", before the first, {first_frame}', expected="frames of the video",
            advice="--first-frame is the number in the name of the video's first frame",
        )  # fmt: skip
    return camera.name, frame


def _called(camera: CameraSettings) -> list[str]:
    """What pictures of a camera begin with."""
    video = [] if camera.video is None else [camera.video.name, camera.video.stem]
    return [*video, camera.name]


def _begins(stem: str, name: str) -> bool:
    """Whether a picture's name is `name`, perhaps with words, and a number set apart from it."""
    rest = stem[len(name) :]
    return stem.lower().startswith(name.lower()) and bool(
        re.fullmatch(r"|(?:[^0-9A-Za-z]+(?:f|frame)?[^0-9A-Za-z]*)\d+", rest)
    )


def _check_names(flight: Flight, names: Collection[str], path: Path) -> None:
    taken = {m.name for m in flight.landmarks} | {t.name for t in flight.targets}
    twice = sorted(taken & set(names))
    if twice:
        raise UsageError(
            where=str(path), seen=f'a point "{twice[0]}"', expected="names that the flight file does not have yet",
            advice=f"rename it, or take it out of {flight.path}",
        )  # fmt: skip


def _target(flight: Flight, write: Path | None) -> Path:
    target = write or flight.path.with_name(f"{flight.path.stem}{SUFFIX}.toml")
    if target.resolve().parent != flight.path.resolve().parent:
        raise WriteError(
            where=str(target), seen="another folder than the flight file's",
            expected="a name in that folder, since paths in a flight file are relative to it",
            advice=f"--write {flight.path.parent / target.name}",
        )  # fmt: skip
    if target.exists():
        raise WriteError(
            where=str(target), seen="a file of that name", expected="a free name: nothing of yours is written over",
            advice="move it away, or give --write another-name.toml",
        )  # fmt: skip
    return target


def _table(point: ControlPoint, at: Places, k: int, seen: Seen, options: LandmarkOptions) -> str:
    """The table of one landmark, place `k` of all."""
    sigma, sigma_px = point.sigma_m or options.sigma_m, repr(options.sigma_px)
    up = point.sigma_up_m or options.sigma_up_m
    lines = [
        f"[landmarks.{_key(point.name)}]", f"lat = {at.lat_deg[k]:.10f}", f"lon = {at.lon_deg[k]:.10f}",
        f"height = {at.height_m[k]:.4f}", f'datum = "{at.datum}"', f"sigma_m = {sigma!r}",
    ]  # fmt: skip
    if up is not None:
        lines.append(f"sigma_up_m = {up!r}")
    if point.name in options.check:
        lines.append("check = true")
    for camera, marks in sorted(seen.items()):
        rows = [
            f"    {{ frame = {frame}, x = {_shortest(m.x_px)}, y = {_shortest(m.y_px)}, sigma_px = {sigma_px} }},"
            for frame, m in sorted(marks.items())
        ]
        lines += [f"points.{_key(camera)} = [", *rows, "]"]
    return "\n".join(["", *lines]) + "\n"


def _shortest(value: float) -> str:
    return f"{round(value, 4):.10g}"


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _warnings(others: Sequence[str], unseen: Sequence[str]) -> list[str]:
    said = []
    if others:
        said.append(f"{len(others)} pictures are of no camera and left out, such as {others[0]}")
    if unseen:
        said.append(f"points that no camera sees are left out: {', '.join(unseen[:10])}")
    return said
