"""Stage 4 as commands run it: tracks and poses become a solution and its files, swapped in together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from calibration.foundation.progress import Progress, silent
from pipeline.export import export_all, poses_csv
from pipeline.flight import Flight
from pipeline.records import Results, Solution, SolverSettings
from pipeline.report import render_report
from pipeline.solver import how_compiled, make_ready, solve
from pipeline.stages.inputs.tracks import read_tracks, wanted
from pipeline.stages.pictures.reading import with_pictures
from pipeline.stages.poses.measured import MeasuredPoses
from pipeline.stages.problem.build import build_problem
from pipeline.stages.running.check import doubts_of
from pipeline.stages.running.inputs import check_inputs
from pipeline.stages.running.ledger import Ledger, key_of, writing
from pipeline.stages.running.poses import Measure, measuring
from pipeline.stages.running.provenance import decisive, input_hashes, tracks_hash
from pipeline.stages.running.results import all_refined, gather_results
from pipeline.stages.running.summary import RunSummary, StageSeconds
from pipeline.stages.running.track import tracking_notes

PLAIN_LOOPS = (
    "the solver's loops are not compiled here and take some 20 times as long: install a C compiler and the package "
    "anew, or numba (`pip install 'runningfix[fast]'`)"
)
"""Measured: normal equations of 4 cameras, 1500 frames and 4 targets, 117 ms instead of 4.6."""


def loops_note() -> tuple[str, ...]:
    """What an installation without compiled loops costs."""
    return (PLAIN_LOOPS,) if how_compiled() == "no" else ()


def run_solve(
    flight: Flight, out: Path, *, settings: SolverSettings | None = None, progress: Progress = silent
) -> RunSummary:
    """Adjusts the flight and writes everything that comes of it."""
    clock = StageSeconds(progress)
    with clock.stage("check"):
        models, measure = check_inputs(flight, out), measuring(flight, progress)
    with writing(out) as ledger:
        with clock.stage("check"):
            doubts = doubts_of(ledger, flight, models, measure)
        return solve_into(
            ledger, flight, measure, settings=settings, doubts=doubts, resume=False, progress=progress, clock=clock
        )


def solve_into(
    ledger: Ledger,
    flight: Flight,
    measure: Measure,
    *,
    settings: SolverSettings | None = None,
    doubts: Sequence[str] = (),
    resume: bool,
    progress: Progress = silent,
    clock: StageSeconds | None = None,
) -> RunSummary:
    """`run_solve` into a folder that is open; with `resume`, a finished solution is left as it is."""
    clock, out = clock or StageSeconds(progress), ledger.out
    chosen = settings or solver_settings(flight)
    with clock.stage("read"):
        models = check_inputs(flight, out)
        tracks = wanted(flight, read_tracks(flight, out))
        hashes = input_hashes(flight)
        key = key_of({
            "stage": "solve", "inputs": hashes, "tracks": tracks_hash(tracks), "settings": asdict(chosen),
            "flight": asdict(flight.solve), "made with": decisive(),
        })  # fmt: skip
    if resume and ledger.finished("solve", key):
        return RunSummary(
            files=tuple(sorted(ledger.files("solve"))), seconds=clock.seconds, skipped=("solve",),
            warnings=ledger.warnings("solve"),
        )  # fmt: skip
    with clock.stage("poses"):
        opened, measured = measure()
    with clock.stage("compile"):
        make_ready(lambda done, of: progress("compile the solver, once on this machine, about a minute", done, of))
    with clock.stage("solve"):
        built = build_problem(flight, tracks, measured, models, opened.origin)
        solution = solve(built.problem, chosen, part=clock.stage)
    with clock.stage("results"):
        notes = (*doubts, *tracking_notes(flight, ledger), *loops_note())
        results = gather_results(flight, solution, tracks, measured, built, opened.origin, hashes, notes)
    with clock.stage("pictures"):
        refined = all_refined(measured, solution)
        results = with_pictures(flight, results, poses=refined, ground=built.problem.ground, progress=progress)
    with clock.stage("write"):
        files = outputs(results, measured, solution)
        ledger.record("solve", key, files, warnings=results.warnings)
    return RunSummary(
        files=tuple(files),
        seconds=clock.seconds,
        results=results,
        problem=built.problem,
        warnings=ledger.warnings("solve"),
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


def outputs(results: Results, measured: Sequence[MeasuredPoses], solution: Solution) -> dict[str, str | bytes]:
    """Every file that a solved flight leaves: name -> content."""
    return {
        "poses.csv": poses_csv([m.poses for m in measured], all_refined(measured, solution)),
        **export_all(results),
        "report.html": render_report(results),
    }
