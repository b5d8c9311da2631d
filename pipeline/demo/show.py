"""Rendering the demo flight, calibrating, running it, comparing it with its truth."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from calibration import Board, calibrate_files, write_camera
from calibration.foundation.progress import Progress, silent
from pipeline.demo.compare import compare
from pipeline.flight import read_flight
from pipeline.records import Results, SolverSettings
from pipeline.report import render_report
from pipeline.solver import solve
from pipeline.stages import RunSummary
from pipeline.stages.running.ledger import writing
from pipeline.stages.running.poses import run_poses
from pipeline.stages.running.solve import run_solve
from pipeline.stages.running.track import run_track
from pipeline.synthetic import demo_scene, read_truth, write_flight

BOARD = Board(cols=9, rows=6, square_m=0.025)


@dataclass(frozen=True, kw_only=True, eq=False)
class DemoSummary:
    """What the demo did: its flight file, the solve, the comparison with the truth, seconds of each part."""

    flight: Path
    run: RunSummary
    results: Results
    seconds: Mapping[str, float]


def run_demo(folder: Path, *, seed: int, progress: Progress = silent) -> DemoSummary:
    """Renders a flight into `folder`, processes it into `folder`/out knowing nothing of the truth, then compares."""
    seconds: dict[str, float] = {}
    with timed(seconds, "render"):
        path = write_flight(demo_scene(seed), folder, seed=seed, progress=progress)
    with timed(seconds, "calibrate"):
        calibrate_boards(folder, progress)
    flight, out = read_flight(path), folder / "out"
    for stage in (run_track, run_poses, run_solve):
        summary = stage(flight, out, progress=progress)
        seconds |= summary.seconds
    with timed(seconds, "compare"):
        results = compare_with_truth(summary, folder)
        with writing(out) as ledger:
            ledger.record("compare", "", {"report.html": render_report(results), "comparison.csv": table(results)})
    return DemoSummary(flight=path, run=summary, results=results, seconds=seconds)


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Notes how long the block took."""
    begin = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - begin


def calibrate_boards(folder: Path, progress: Progress) -> None:
    """Every folder `board-NAME` of photos becomes `NAME.json`, as `runningfix calibrate` does it."""
    for photos in sorted(folder.glob("board-*")):
        found = calibrate_files([photos], BOARD, progress=partial(progress, f"photos {photos.name}"))
        write_camera(folder / f"{photos.name.removeprefix('board-')}.json", found.camera)


def compare_with_truth(summary: RunSummary, folder: Path) -> Results:
    """The results with the truth beside them; before the adjustment is `intersection` on the clocks as given."""
    assert summary.results is not None
    assert summary.problem is not None
    truth = read_truth(folder)
    before = solve(summary.problem, SolverSettings(method="intersection"))
    return replace(summary.results, truth=truth, comparison=compare(summary.results, before, truth))


def table(results: Results) -> str:
    """The comparison as CSV."""
    rows = [f"{c.what},{c.unit},{c.before:.6g},{c.after:.6g},{c.sigma:.6g}" for c in results.comparison]
    return "\n".join(["what,unit,before,after,claimed_sigma", *rows]) + "\n"
