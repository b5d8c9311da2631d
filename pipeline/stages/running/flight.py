"""All stages, one after the other: what is finished is not done again.

    track -> tracks.csv        poses -> poses.csv        solve -> everything else

A run killed at any moment leaves whole files only; the next one goes on from there and gives the same bytes.
"""

from __future__ import annotations

from pathlib import Path

from calibration.foundation.progress import Progress, silent
from pipeline.flight import Flight
from pipeline.stages.running.check import doubts_of
from pipeline.stages.running.inputs import check_inputs
from pipeline.stages.running.ledger import writing
from pipeline.stages.running.poses import measuring, poses_into
from pipeline.stages.running.solve import solve_into
from pipeline.stages.running.summary import RunSummary, StageSeconds
from pipeline.stages.running.track import track_into


def run_flight(flight: Flight, out: Path, *, progress: Progress = silent) -> RunSummary:
    """All stages; what is finished is not done again."""
    clock = StageSeconds(progress)
    with clock.stage("check"):
        models, measure = check_inputs(flight, out), measuring(flight, progress)
    with writing(out) as ledger:
        with clock.stage("check"):
            doubts = doubts_of(ledger, flight, models, measure)
        parts = [
            track_into(ledger, flight, resume=True, progress=progress),
            poses_into(ledger, flight, measure, StageSeconds(progress), resume=True),
            solve_into(ledger, flight, measure, doubts=doubts, resume=True, progress=progress),
        ]
    for part in parts:
        clock.add(part.seconds)
    return RunSummary(
        files=tuple(dict.fromkeys(name for part in parts for name in part.files)),
        seconds=clock.seconds,
        skipped=tuple(name for part in parts for name in part.skipped),
        warnings=tuple(dict.fromkeys((*doubts, *(warning for part in parts for warning in part.warnings)))),
        results=parts[-1].results,
        problem=parts[-1].problem,
    )
