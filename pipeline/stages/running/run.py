"""The stages as commands run them: what they read, what they leave in the output folder, what need not be done again.

    track -> tracks.csv        poses -> poses.csv        solve -> everything else

A run killed at any moment leaves whole files only; the next one skips what is finished and gives the same bytes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path

from calibration.camera import CameraModel
from calibration.foundation.errors import InputFileError
from calibration.foundation.progress import Progress, silent
from pipeline.export import export_all, poses_csv, read_tracks_csv, tracks_csv
from pipeline.flight import Flight
from pipeline.records import ImageTrack, Problem, Results, Solution, SolverSettings
from pipeline.report import render_report
from pipeline.solver import solve
from pipeline.stages.inputs.sources import Sources, open_sources
from pipeline.stages.inputs.tracks import boxes_of, detections, draw_overlay, read_tracks, wanted
from pipeline.stages.poses.measure import measure_poses
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.build import build_problem
from pipeline.stages.problem.rays import read_models
from pipeline.stages.running.ledger import FOLDER, Ledger, key_of
from pipeline.stages.running.results import all_refined, file_hash, gather_results, input_files, versions
from pipeline.stages.running.workers import track_all

Opener = Callable[[], Sources]


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSummary:
    """What a command did.

    files     written or found finished, relative to the output folder
    seconds   per stage; "solver" is the numerical solve alone
    skipped   stages found finished
    results, problem  of `solve`, where it was done now
    """

    files: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    skipped: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    results: Results | None = None
    problem: Problem | None = None


class _Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin


def _hashes(flight: Flight) -> dict[str, str]:
    return {name: file_hash(path) for name, path in input_files(flight).items()}


def check_inputs(flight: Flight) -> dict[str, CameraModel]:
    """Looks at every input that is quickly looked at, so that a long run does not fail at its end; the cameras.

    Raises InputFileError where a file is missing or a camera file is wrong.
    """
    for camera in flight.cameras:
        for key in ("calibration", "video", "tracks", "telemetry"):
            path: Path | None = getattr(camera, key)
            if path is not None and not path.is_file():
                photos = "make it with `runningfix calibrate`" if key == "calibration" else "check the name"
                raise InputFileError(
                    where=str(path),
                    seen="no such file",
                    expected=f"what cameras.{camera.name}.{key} in {flight.path} names",
                    advice=f"{photos}; paths are relative to the flight file",
                )
    return read_models(flight)


# --- track ---------------------------------------------------------------------------------------------------------


def run_track(
    flight: Flight, out: Path, *, resume: bool = False, overlay: bool = False, progress: Progress = silent
) -> RunSummary:
    """Tracks every video, camera by camera, then writes `tracks.csv`, and with `overlay` the drawn-on videos."""
    clock, ledger = _Clock(), Ledger(out)
    drawn: list[str] = []
    with clock.stage("track"):
        keys = _track_keys(flight)
        todo = [name for name, key in keys.items() if not (resume and ledger.finished(_entry(flight, name), key))]
        for name, found in track_all(flight, todo, progress):
            ledger.record(
                _entry(flight, name),
                keys[name],
                {_part(flight, name): tracks_csv(found.tracks), _notes(flight, name): "\n".join(found.notes)},
            )
            if overlay:
                drawn.append(draw_overlay(flight, name, found, out, progress))
        key = key_of({"parts": keys, "detections": _detection_hashes(flight)})
        skipped = resume and not todo and ledger.finished("track", key)
        if not skipped:
            ledger.record("track", key, {"tracks.csv": tracks_csv(_joined(flight, out))})
    return RunSummary(
        files=("tracks.csv", *drawn),
        seconds=clock.seconds,
        skipped=("track",) if skipped else (),
        warnings=tracking_notes(flight, out),
    )


def _tracked(flight: Flight) -> list[str]:
    return [c.name for c in flight.cameras if c.tracks is None and c.video is not None]


def _entry(flight: Flight, name: str) -> str:
    """Camera names are free text, so files go by the camera's place in the flight file."""
    return f"track-{[c.name for c in flight.cameras].index(name)}"


def _part(flight: Flight, name: str) -> str:
    return f"{FOLDER}/tracks/{_entry(flight, name)}.csv"


def _notes(flight: Flight, name: str) -> str:
    return f"{FOLDER}/tracks/{_entry(flight, name)}.txt"


def _track_keys(flight: Flight) -> dict[str, str]:
    keys = {}
    for name in _tracked(flight):
        camera = flight.camera(name)
        assert camera.video is not None
        boxes = {target: asdict(box) for target, box in boxes_of(flight, camera).items()}
        keys[name] = key_of({
            "camera": name, "video": file_hash(camera.video) if camera.video.exists() else None, "boxes": boxes,
            "tracker": camera.tracker, "frame_rate": camera.frame_rate, "pixel": camera.sigma.get("pixel_px"),
            "versions": versions(),
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


def tracking_notes(flight: Flight, out: Path) -> tuple[str, ...]:
    """What tracking noted, one sentence each."""
    found: list[str] = []
    for name in _tracked(flight):
        path = out / _notes(flight, name)
        if path.exists():
            found += [f"{name}: {line}" for line in path.read_text().splitlines() if line]
    return tuple(found)


# --- poses ---------------------------------------------------------------------------------------------------------


def run_poses(
    flight: Flight, out: Path, *, resume: bool = False, progress: Progress = silent, opener: Opener | None = None
) -> RunSummary:
    """Reads the logs and writes `poses.csv` at every frame."""
    clock, ledger = _Clock(), Ledger(out)
    notes: tuple[str, ...] = ()
    with clock.stage("poses"):
        key = key_of({"stage": "poses", "inputs": _hashes(flight), "versions": versions()})
        skipped = resume and ledger.finished("poses", key)
        if not skipped:
            measured = _measured(flight, opener or _opener(flight, progress), progress)[1]
            notes = tuple(f"{m.camera}: {note}" for m in measured for note in m.notes)
            ledger.record("poses", key, {"poses.csv": poses_csv([m.poses for m in measured])})
    return RunSummary(
        files=("poses.csv",), seconds=clock.seconds, skipped=("poses",) if skipped else (), warnings=notes
    )


def _opener(flight: Flight, progress: Progress) -> Opener:
    """Opens the logs when they are first needed, and once."""
    return cache(lambda: open_sources(flight, lambda name, share: progress(f"log {name}", int(100 * share), 100)))


def _measured(flight: Flight, opener: Opener, progress: Progress) -> tuple[Sources, tuple[MeasuredPoses, ...]]:
    own: list[ImageTrack] = []
    for camera in flight.cameras:
        if camera.tracks is not None:
            own += detections(flight, camera)
    sources = opener()
    return sources, measure_poses(flight, sources, tuple(own), progress)


# --- solve ---------------------------------------------------------------------------------------------------------


def run_solve(
    flight: Flight,
    out: Path,
    *,
    settings: SolverSettings | None = None,
    resume: bool = False,
    progress: Progress = silent,
    opener: Opener | None = None,
) -> RunSummary:
    """Adjusts the flight and writes everything that comes of it."""
    models = check_inputs(flight)
    clock, ledger = _Clock(), Ledger(out)
    chosen = settings or solver_settings(flight)
    with clock.stage("read"):
        tracks = wanted(flight, read_tracks(flight, out))
        hashes = _hashes(flight)
        key = key_of({
            "stage": "solve", "inputs": hashes, "tracks": tracks_csv(tracks), "settings": asdict(chosen),
            "versions": versions(),
        })  # fmt: skip
    if resume and ledger.finished("solve", key):
        return RunSummary(files=solve_files(out), seconds=clock.seconds, skipped=("solve",))
    with clock.stage("poses"):
        opened, measured = _measured(flight, opener or _opener(flight, progress), progress)
    with clock.stage("solve"):
        built = build_problem(flight, tracks, measured, models)
        progress("solve", 0, 1)
        solution = solve(built.problem, chosen)
        progress("solve", 1, 1)
    clock.seconds["solver"] = solution.seconds
    with clock.stage("write"):
        results = gather_results(
            flight, solution, tracks, measured, built, opened.origin, hashes, tracking_notes(flight, out)
        )
        files = outputs(results, measured, solution)
        ledger.record("solve", key, files)
        _remove_stale(out, files)
    return RunSummary(
        files=tuple(files), seconds=clock.seconds, results=results, problem=built.problem, warnings=results.warnings
    )


def solver_settings(flight: Flight) -> SolverSettings:
    """The solver's settings as the flight file gives them."""
    given = flight.solve
    return SolverSettings(
        method=given.method,
        refine_frame_rate=given.frame_rate == "refine",
        robust=given.robust,
        search_s=given.search_s,
    )


def outputs(results: Results, measured: Sequence[MeasuredPoses], solution: Solution) -> dict[str, str]:
    """Every file that a solved flight leaves: name -> content."""
    return {
        "poses.csv": poses_csv([m.poses for m in measured], all_refined(measured, solution)),
        **export_all(results),
        "report.html": render_report(results),
    }


def solve_files(out: Path) -> tuple[str, ...]:
    """The files that a finished solve left."""
    return tuple(sorted(Ledger(out).files("solve")))


def _remove_stale(out: Path, files: Mapping[str, str]) -> None:
    """An earlier run's files that this one does not write would speak of another solution."""
    for pattern in ("clock.csv", "trajectory*"):
        for path in out.glob(pattern):
            if path.name not in files:
                path.unlink()


# --- everything ----------------------------------------------------------------------------------------------------


def run_flight(flight: Flight, out: Path, *, progress: Progress = silent) -> RunSummary:
    """All stages; what is finished is not done again."""
    check_inputs(flight)
    opener = _opener(flight, progress)
    parts = [
        run_track(flight, out, resume=True, progress=progress),
        run_poses(flight, out, resume=True, progress=progress, opener=opener),
        run_solve(flight, out, resume=True, progress=progress, opener=opener),
    ]
    seconds: dict[str, float] = {}
    for part in parts:
        for name, value in part.seconds.items():
            seconds[name] = seconds.get(name, 0.0) + value
    return RunSummary(
        files=tuple(dict.fromkeys(name for part in parts for name in part.files)),
        seconds=seconds,
        skipped=tuple(name for part in parts for name in part.skipped),
        warnings=tuple(dict.fromkeys(warning for part in parts for warning in part.warnings)),
        results=parts[-1].results,
    )
