"""Stage 2 as commands run it: every video's tracks, camera by camera, joined in tracks.csv."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from calibration.foundation.progress import Progress, silent
from pipeline.export import read_tracks_csv, tracks_csv
from pipeline.flight import Flight
from pipeline.records import ImageTrack
from pipeline.stages.checks.outlook import Outlook, refuse
from pipeline.stages.checks.videos import video_doubts
from pipeline.stages.inputs.tracks import boxes_of, detections, draw_overlay
from pipeline.stages.running.inputs import check_inputs, not_calibrated
from pipeline.stages.running.ledger import FOLDER, Ledger, key_of, writing
from pipeline.stages.running.provenance import decisive, file_hash
from pipeline.stages.running.summary import RunSummary, StageSeconds
from pipeline.stages.running.workers import track_all
from pipeline.tracking import VideoTracks, video_times

MADE_OF_TRACKS = ("solve", "compare")
"""Stages whose results are void with other tracks."""


def run_track(
    flight: Flight, out: Path, *, resume: bool = False, overlay: bool = False, progress: Progress = silent
) -> RunSummary:
    """Tracks every video, with `resume` only what is not finished, then writes `tracks.csv`; draws with `overlay`."""
    check_inputs(flight, out, cameras_later=True)
    videos = {c.name: video_times(c.video, c.video_stream) for c in flight.cameras if c.video is not None}
    refuse(Outlook(doubts=tuple(video_doubts(flight, videos))))
    with writing(out) as ledger:
        return track_into(ledger, flight, resume=resume, overlay=overlay, progress=progress)


def track_into(
    ledger: Ledger, flight: Flight, *, resume: bool, overlay: bool = False, progress: Progress = silent
) -> RunSummary:
    """`run_track` into a folder that is open; with `resume`, cameras that are finished are left as they are."""
    clock = StageSeconds(progress)
    drawn: list[str] = []
    with clock.stage("track"):
        keys = _keys(flight)
        todo = [name for name, key in keys.items() if not (resume and ledger.finished(_entry(flight, name), key))]
        for name, found in track_all(flight, todo, progress):
            table = {_part(flight, name): tracks_csv(found.tracks)}
            ledger.record(_entry(flight, name), keys[name], table, warnings=found.notes)
            if overlay:
                drawn += _overlay(ledger, flight, name, found, progress)
        key = key_of({"parts": keys, "detections": _detection_hashes(flight)})
        skipped = resume and not todo and ledger.finished("track", key)
        if not skipped:
            text = tracks_csv(_joined(flight, ledger.out))
            void = () if ledger.same("tracks.csv", text) else MADE_OF_TRACKS
            ledger.record("track", key, {"tracks.csv": text}, drop=void)
    return RunSummary(
        files=("tracks.csv", *drawn),
        seconds=clock.seconds,
        skipped=("track",) if skipped else (),
        warnings=(*_unchecked(flight), *tracking_notes(flight, ledger), *ledger.warnings("track")),
    )


def _unchecked(flight: Flight) -> list[str]:
    return [
        f"{name}: {flight.camera(name).calibration.name} does not exist yet, so nobody knows whether it fits the video"
        for name in not_calibrated(flight)
    ]


def tracking_notes(flight: Flight, ledger: Ledger) -> tuple[str, ...]:
    """What tracking noted, one sentence each."""
    return tuple(f"{name}: {line}" for name in _tracked(flight) for line in ledger.warnings(_entry(flight, name)))


def _overlay(ledger: Ledger, flight: Flight, name: str, found: VideoTracks, progress: Progress) -> list[str]:
    """Draws one camera's video, then swaps it in; its name."""
    file = draw_overlay(flight, name, found, ledger.folder, progress)
    ledger.record(f"overlay-{_number(flight, name)}", "", {file: ledger.folder / file})
    return [file]


def _tracked(flight: Flight) -> list[str]:
    return [c.name for c in flight.cameras if c.tracks is None and c.video is not None]


def _number(flight: Flight, name: str) -> int:
    """Camera names are free text, so files go by the camera's place in the flight file."""
    return [c.name for c in flight.cameras].index(name)


def _entry(flight: Flight, name: str) -> str:
    return f"track-{_number(flight, name)}"


def _part(flight: Flight, name: str) -> str:
    return f"{FOLDER}/tracks/{_entry(flight, name)}.csv"


def _keys(flight: Flight) -> dict[str, str]:
    keys = {}
    for name in _tracked(flight):
        camera = flight.camera(name)
        assert camera.video is not None
        boxes = {target: [asdict(box) for box in labels] for target, labels in boxes_of(flight, camera).items()}
        keys[name] = key_of({
            "camera": name, "video": file_hash(camera.video) if camera.video.exists() else None, "boxes": boxes,
            "tracker": camera.tracker, "stream": camera.video_stream, "frame_rate": camera.frame_rate,
            "pixel": camera.sigma.get("pixel_px"),
            "made with": decisive(),
        })  # fmt: skip
    return keys


def _detection_hashes(flight: Flight) -> dict[str, str]:
    return {c.name: file_hash(c.tracks) for c in flight.cameras if c.tracks is not None and c.tracks.exists()}


def _joined(flight: Flight, out: Path) -> tuple[ImageTrack, ...]:
    found: list[ImageTrack] = []
    for camera in flight.cameras:
        if camera.tracks is not None:
            found += detections(flight, camera)
        elif camera.video is not None:
            found += read_tracks_csv(out / _part(flight, camera.name))
    return tuple(found)
