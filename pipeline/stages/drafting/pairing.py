"""Which log and which camera file belong to which video: by name, by time, by size, or because one is left."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from calibration.camera import CameraModel
from pipeline.stages.drafting.folder import Found
from pipeline.telemetry import FlightLog, log_span

T = TypeVar("T")
KINDS = "video vid log flight camera cam calibration tracks poses detections mot mov img dji drone"
GENERIC = frozenset(KINDS.split())
"""Words in file names that say what a file is, and not whose."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """A file chosen for a camera, and by what: empty where the name leaves no doubt."""

    path: Path | None
    guess: str = ""


@dataclass(frozen=True, kw_only=True)
class DraftCamera:
    """One camera of a draft: its video or table of detections, log, and camera file."""

    name: str
    video: Path | None
    tracks: Path | None
    log: Choice
    calibration: Choice


def draft_cameras(found: Found) -> tuple[DraftCamera, ...]:
    """A camera for each video, and for each table of detections that belongs to no video."""
    tables = list(found.detections)
    bases: list[tuple[Path | None, Path | None]] = []
    for video in found.videos:
        mine = [t for t in tables if (related(t, video) and t.stem != video.stem) or t.stem == video.stem]
        own = mine[0] if mine else None
        if own is not None:
            tables.remove(own)
        bases.append((video, own))
    bases += [(None, table) for table in tables]
    taken: set[str] = set()
    logs = _assigned([video or table for video, table in bases], list(found.logs), found, logs=True)
    files = _assigned([video or table for video, table in bases], list(found.cameras), found, logs=False)
    cameras = []
    for (film, table), log, file in zip(bases, logs, files, strict=True):
        stem = film.stem if film is not None else KIND.sub("", table.stem if table is not None else "")
        name = _name(stem, taken)
        cameras.append(DraftCamera(name=name, video=film, tracks=table, log=log, calibration=file))
    return tuple(cameras)


def words_of(path: Path) -> set[str]:
    """What a file's name says of whose it is: words and numbers, without what only says its kind."""
    parts = re.findall(r"[a-z]+\d*|\d+", path.stem.lower())
    return {part for part in parts if part not in GENERIC}


def related(one: Path, other: Path) -> bool:
    """Whether two names are of one camera: the same, one begins with the other, or they share a word that tells."""
    short, long = sorted((one.stem.lower(), other.stem.lower()), key=len)
    begins = long.startswith(short) and not long[len(short) : len(short) + 1].isdigit()
    return begins or bool(words_of(one) & words_of(other))


def _assigned(bases: Sequence[Path | None], files: Sequence[Path], found: Found, *, logs: bool) -> list[Choice]:
    """A file for each base: by name first, where that is clear; then by what is in them; then the one that is left."""
    chosen: dict[int, Choice] = {}
    for k, base in enumerate(bases):
        assert base is not None
        same = [f for f in files if f.stem.lower() == base.stem.lower()]
        like = same or [f for f in files if related(f, base)]
        others = [b for i, b in enumerate(bases) if i != k and b is not None]
        mine = same or [f for f in like if not any(related(f, b) for b in others)]
        if len(mine) == 1 or same:
            chosen[k] = Choice(path=mine[0])
    left = [f for f in files if f not in {c.path for c in chosen.values()}]
    for k, one in enumerate(bases):
        if k in chosen:
            continue
        fitting = _fitting(one, left, found) if not logs else _by_time(one, left, found)
        only = left if len(left) == 1 and len([i for i in range(len(bases)) if i not in chosen]) == 1 else []
        if len(fitting) == 1:
            chosen[k] = Choice(path=fitting[0], guess="the pictures' size" if not logs else "the times of day")
        elif only:
            chosen[k] = Choice(path=only[0], guess="it is the one that is left")
        elif not logs and len(found.cameras) == 1:
            chosen[k] = Choice(path=next(iter(found.cameras)), guess="it is the only camera file")
        if k in chosen:
            left = [f for f in left if f != chosen[k].path]
    return [chosen.get(k, Choice(path=None)) for k in range(len(bases))]


def _fitting(base: Path | None, files: Iterable[Path], found: Found) -> list[Path]:
    """Camera files that were made for pictures of the video's size."""
    times = None if base is None else found.videos.get(base)
    models: dict[Path, CameraModel] = found.cameras
    return [] if times is None else [f for f in files if tuple(models[f].image_size) == tuple(times.image_size)]


def _by_time(base: Path | None, files: Iterable[Path], found: Found) -> list[Path]:
    """Logs in whose span of UTC the video's file was last written, or its length before that."""
    times = None if base is None else found.videos.get(base)
    if base is None or times is None:
        return []
    end = base.stat().st_mtime
    begin = end - float(times.frame_time_s[-1])
    return [f for f in files if _covers(found.logs[f], begin, end)]


def _covers(log: FlightLog | None, begin_s: float, end_s: float) -> bool:
    if log is None or log.utc is None:
        return False
    first, last = (log.utc.other_s(t) for t in log_span(log))
    return bool(first <= begin_s and end_s <= last)


KIND = re.compile(r"[-_. ](tracks|detections|mot)$", re.IGNORECASE)


def _name(stem: str, taken: set[str]) -> str:
    """A camera's name from its file's, with letters that need no quotes."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-") or "camera"
    name, number = plain, 2
    while name in taken:
        name, number = f"{plain}-{number}", number + 1
    taken.add(name)
    return name
