"""Stage 3 as commands run it: the logs as poses.csv, at every frame.

`solve` writes poses.csv anew with the refined poses beside the measured ones; from then on it is solve's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

from calibration.foundation.progress import Progress, silent
from pipeline.export import poses_csv
from pipeline.flight import Flight
from pipeline.records import ImageTrack
from pipeline.stages.inputs.sources import Sources, open_sources
from pipeline.stages.inputs.tracks import detections, marks_of
from pipeline.stages.poses.measure import measure_poses
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.running.ledger import Ledger, key_of, writing
from pipeline.stages.running.provenance import decisive, input_hashes
from pipeline.stages.running.summary import RunSummary, StageSeconds

Measure = Callable[[], tuple[Sources, tuple[MeasuredPoses, ...]]]
"""Opens a flight's logs and measures its poses when first called, once."""


def measuring(flight: Flight, progress: Progress) -> Measure:
    """The logs and poses of a flight, read when they are first asked for, and once."""

    def measure() -> tuple[Sources, tuple[MeasuredPoses, ...]]:
        own: list[ImageTrack] = []
        for camera in flight.cameras:
            if camera.tracks is not None:
                own += detections(flight, camera)
            own += marks_of(flight, camera)
        sources = open_sources(flight, lambda name, share: progress(f"log {name}", int(100 * share), 100))
        return sources, measure_poses(flight, sources, tuple(own), progress)

    return cache(measure)


def run_poses(flight: Flight, out: Path, *, progress: Progress = silent) -> RunSummary:
    """Reads the logs and writes `poses.csv`; one that `solve` has refined, of the same inputs, stays."""
    measure = measuring(flight, progress)
    clock = StageSeconds(progress)
    with clock.stage("poses"):
        measure()
    with writing(out) as ledger:
        return poses_into(ledger, flight, measure, clock, resume=False)


def poses_into(ledger: Ledger, flight: Flight, measure: Measure, clock: StageSeconds, *, resume: bool) -> RunSummary:
    """`run_poses` into a folder that is open."""
    with clock.stage("poses"):
        key = key_of({"stage": "poses", "inputs": input_hashes(flight), "made with": decisive()})
        finished = ledger.finished("poses", key)
        if not finished:
            measured = measure()[1]
            table = {"poses.csv": poses_csv([m.poses for m in measured])}
            ledger.record("poses", key, table, warnings=pose_notes(measured), drop=("solve", "compare"))
    return RunSummary(
        files=("poses.csv",),
        seconds=clock.seconds,
        skipped=("poses",) if finished and resume else (),
        warnings=ledger.warnings("poses"),
    )


def pose_notes(measured: tuple[MeasuredPoses, ...]) -> tuple[str, ...]:
    """What a reader should know of the measured poses."""
    return tuple(f"{m.camera}: {note}" for m in measured for note in m.notes)
