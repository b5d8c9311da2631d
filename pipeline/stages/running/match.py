"""The match as commands run it: boxes proposed where a video has none, tracked, matched, written under new names."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from calibration.foundation.files import read_bytes, write_whole
from calibration.foundation.progress import Progress, silent
from pipeline.flight import CameraSettings, Flight, TargetSettings
from pipeline.flight.read import LARGEST_BYTES
from pipeline.matching import Matching, TrackName
from pipeline.records import Box
from pipeline.stages.inputs.tracks import read_tracks
from pipeline.stages.matching.duplicates import duplicates
from pipeline.stages.matching.files import matched_paths, matched_tables, matched_text
from pipeline.stages.matching.match import match_flight
from pipeline.stages.matching.names import common_names
from pipeline.stages.running.inputs import check_inputs
from pipeline.stages.running.ledger import writing
from pipeline.stages.running.poses import measuring, pose_notes
from pipeline.stages.running.summary import StageSeconds
from pipeline.stages.running.track import track_into
from pipeline.tracking import propose_targets

MOST_PROPOSED = 12
"""Boxes that are proposed in a video that has none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchRun:
    """What a match came to: names of targets by track, files written (absolute), warnings, seconds by stage."""

    matching: Matching
    names: Mapping[TrackName, str]
    files: tuple[Path, ...]
    warnings: tuple[str, ...]
    seconds: Mapping[str, float]


def run_match(flight: Flight, out: Path, *, write: Path | None = None, progress: Progress = silent) -> MatchRun:
    """Matches the tracks of a flight and writes a new flight file beside it; `out` keeps the tracks.

    Raises WriteError where a file that would be written exists, TrackingError where nothing moves in a video that has
    no boxes, and what its stages raise.
    """
    paths = matched_paths(flight, write)
    text = read_bytes(flight.path, expected="a flight file (TOML)", most=LARGEST_BYTES).decode("utf-8-sig")
    found, files = _matched(flight, text, out, paths, progress)
    for path, content in files.items():
        write_whole(path, content)
    return found


def match_text(
    flight: Flight, text: str, out: Path, *, guessed: Collection[str] = (), progress: Progress = silent
) -> tuple[MatchRun, str]:
    """The match of a flight whose file is `text`, and that text with its targets under common names; for videos.

    Of `guessed` targets those that turn out to be of one vehicle with another are dropped. Nothing but `out` is
    written. Raises as `run_match`.
    """
    found, files = _matched(flight, text, out, {"": flight.path}, progress, guessed)
    return found, files[flight.path]


def _matched(
    flight: Flight, text: str, out: Path, paths: Mapping[str, Path], progress: Progress, guessed: Collection[str] = ()
) -> tuple[MatchRun, dict[Path, str]]:
    """The match, and the files it comes to by path."""
    models = check_inputs(flight, out)
    clock = StageSeconds()
    with clock.stage("detect"):
        full, notes = with_proposals(flight, progress)
    measure = measuring(full, progress)
    with writing(out) as ledger:
        tracked = track_into(ledger, full, resume=True, progress=progress)
    tracks = tuple(t for t in read_tracks(full, out) if t.seen.any())
    boxes = {
        TrackName(camera=camera, target=t.name): box
        for t in full.targets for camera, box in t.boxes.items() if full.camera(camera).tracks is None
    }  # fmt: skip
    proposals = {t.name for t in full.targets} - {t.name for t in flight.targets} | set(guessed)
    twice = duplicates(tracks, boxes, proposals)
    tracks = tuple(t for t in tracks if TrackName(camera=t.camera, target=t.target) not in twice)
    boxes = {track: box for track, box in boxes.items() if track not in twice}
    with clock.stage("poses"):
        measured = measure()[1]
    with clock.stage("match"):
        matching = match_flight(full, tracks, measured, models, progress)
    names = common_names(matching.targets)
    tables = matched_tables(tracks, names, paths)
    new = matched_text(
        text,
        flight,
        boxes,
        _all_named(boxes, names),
        paths,
        _notes(matching, names),
        dropped={track.target for track in twice},
    )
    found = MatchRun(
        matching=matching,
        names=names,
        files=(*tables, paths[""]),
        warnings=(*notes, *_told(twice), *tracked.warnings, *pose_notes(measured), *doubts(matching)),
        seconds={**tracked.seconds, **clock.seconds},
    )
    return found, {**tables, paths[""]: new}


def with_proposals(flight: Flight, progress: Progress = silent) -> tuple[Flight, tuple[str, ...]]:
    """The flight with boxes proposed in every video that has neither boxes nor tracks, named after their camera."""
    targets, notes = list(flight.targets), []
    for camera in flight.cameras:
        if camera.video is None or camera.tracks is not None or any(camera.name in t.boxes for t in flight.targets):
            continue
        boxes = proposed(camera, progress)
        targets += [TargetSettings(name=name, labels={camera.name: (box,)}) for name, box in boxes.items()]
        notes.append(f"{camera.name}: no boxes in the flight file, {len(boxes)} proposed by what moves in its video")
    return replace(flight, targets=tuple(targets)), tuple(notes)


def proposed(camera: CameraSettings, progress: Progress = silent) -> dict[str, Box]:
    """Boxes around what moves in a camera's video, by names that no other camera's have."""
    assert camera.video is not None
    found = propose_targets(
        camera.video, most=MOST_PROPOSED, progress=lambda done, total: progress(f"detect {camera.name}", done, total)
    )
    return {f"{camera.name}-{k + 1}": proposal.box for k, proposal in enumerate(found)}


def doubts(matching: Matching) -> tuple[str, ...]:
    """What a reader of the match should know, a sentence each."""
    found = [
        f"{doubt.pair.first} and {doubt.pair.second} may be one target (margin {doubt.pair.margin:.1f}), and are left "
        f"apart; {doubt.why}"
        for doubt in matching.doubtful
    ]
    if not matching.pairs:
        found.insert(0, "no two tracks are surely of one target")
    return tuple(found)


def _told(twice: Mapping[TrackName, TrackName]) -> list[str]:
    return [
        f"{track} is left out: it was proposed on the same vehicle as {other.target}" for track, other in twice.items()
    ]


def _all_named(boxes: Mapping[TrackName, Box], names: Mapping[TrackName, str]) -> dict[TrackName, str]:
    """Names of all tracks; of boxes that could not be followed too, which nothing else may be called."""
    found, taken = dict(names), set(names.values())
    for track in boxes:
        if track not in found:
            name = track.target if track.target not in taken else f"{track.target}-{track.camera}"
            found[track] = name
            taken.add(name)
    return found


def _notes(matching: Matching, names: Mapping[TrackName, str]) -> dict[str, list[str]]:
    """Comments above each target of the new flight file."""
    found: dict[str, list[str]] = {}
    for target in matching.targets:
        for pair in target.pairs:
            found.setdefault(names[target.tracks[0]], []).append(
                f"matched: {pair.first} = {pair.second}, margin {pair.margin:.1f}"
            )
    for doubt in matching.doubtful:
        for track, other in ((doubt.pair.first, doubt.pair.second), (doubt.pair.second, doubt.pair.first)):
            found.setdefault(names[track], []).append(
                f"doubtful: may be {names[other]}, as {other.camera} sees it (margin {doubt.pair.margin:.1f})"
            )
    return found
