"""Stage 4: sight rays, measured poses and clocks' first guesses become motions, clocks and corrected poses.

Six methods over one residual, one clock and one motion basis:

    triangulation   points of synchronised frames (paper eq. 6), and a motion through them
    intersection    the motion at given times (paper eq. 8)
    li              intersection and offsets in turn (paper section 2.3)
    algorithm-1     motion, offsets and frame rates together (paper eq. 9 to 11)
    algorithm-2     the same with a free rotation for every frame (paper eq. 14, 15)
    map             the statistical form of all of it (this project's own)
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibration.foundation.compiled import announced
from calibration.foundation.compiled import how_compiled as how_module_compiled
from calibration.foundation.errors import GeometryError
from calibration.foundation.progress import Part, uncounted
from pipeline.records import Finding, OffsetCandidate, Problem, Solution, SolverSettings
from pipeline.solver.adjustment import _kernels, compiled_descent
from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.levenberg_marquardt import SMALL, Descent, Fit, Progress, levenberg_marquardt
from pipeline.solver.adjustment.log_poses import Renew
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.adjustment.renewal import renewing, rolled
from pipeline.solver.judgement import judged, with_findings, with_landmarks, with_refusal
from pipeline.solver.methods import li, map_estimation
from pipeline.solver.methods.initialisation import candidates
from pipeline.solver.methods.intersection import intersect, intersected
from pipeline.solver.methods.parameters import FIRST_ORDER, first_camera, first_choice, first_model, given_offsets
from pipeline.solver.methods.results import Outcome, solution_of
from pipeline.solver.methods.triangulation import triangulate
from pipeline.solver.observability.findings import find_degeneracies
from pipeline.solver.observability.magnitudes import check_magnitudes
from pipeline.solver.observation.observations import Frames, metric, pack, with_poses_of
from pipeline.solver.observation.rolling_shutter import has_rows, with_rows
from pipeline.solver.observation.selection import without_landmarks, without_targets
from pipeline.solver.offset_search._frame_sums import frame_sums
from pipeline.solver.offset_search.views import View, views
from pipeline.solver.uncertainty.covariance import Inverse

RENEWING = ("algorithm-1", "algorithm-2", "map")
"""Methods that move clocks' rates or the starts of videos, and so take poses from logs anew."""
LI_ROUNDS = 500
LOW_WEIGHT, FIFTH = 0.5, 0.2
"""Weight below which a sighting hardly counts, and the share of them from which on that is said."""
EARLY = 1e-3
"""Relative change of the cost that ends `algorithm-2`; see `start.pose_errors`."""
Finish = Callable[[], Outcome]
"""What is left to do after the optimum is found: covariances."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """What a method is asked: `starts` are the offsets to begin at, best first, `renew` what it takes anew."""

    problem: Problem
    settings: SolverSettings
    frames: Frames
    starts: tuple[OffsetCandidate, ...]
    progress: Progress | None
    renew: Renew | None = None


def solve(
    problem: Problem, settings: SolverSettings, *, progress: Progress | None = None, part: Part = uncounted
) -> Solution:
    """Adjust `problem` by `settings.method`.

    `progress` is called with (iteration, cost), `part` told of "search", "solver" and "judge" in turn.
    `Solution.seconds` counts the numerical solve alone: from packed arrays to the optimum, without the search of
    offsets, the covariances and the making of the record.

    Raises GeometryError where the sightings cannot determine the answer; what a prior decides is a finding. Not
    converging is a status, not an error.
    """
    check_magnitudes(problem)
    checks = [t.target for t in problem.targets if t.check]
    if not checks:
        return _without_the_undetermined(problem, settings, progress, part)
    adjusted = without_targets(problem, checks)
    if adjusted is None:
        raise _nothing_but_checks(checks)
    solution = _without_the_undetermined(adjusted, settings, progress, part)
    with part("judge"):
        return with_check_points(problem, settings, solution)


def _nothing_but_checks(checks: list[str]) -> GeometryError:
    return GeometryError(
        where=f"landmarks {', '.join(checks)}",
        seen="the reference camera sees nothing but check points",
        expected="targets beside them",
        advice="leave check = true out, or track a target",
    )


def with_check_points(problem: Problem, settings: SolverSettings, solution: Solution) -> Solution:
    """The solution with where its check points are, by a second adjustment in which their coordinates take no part.

    It starts from the clocks of the first, and only the check points are taken from it. Their sightings do take part in
    it, as those of unknown still points; nothing else of the solution is touched by them.
    """
    clocks = {c.camera: c for c in solution.clocks}
    cameras = tuple(
        replace(c, offset_s=clocks[c.camera].offset_s)
        if c.camera in clocks and c.sigma.offset_s is None and c.camera != problem.reference_camera
        else c
        for c in problem.cameras
    )
    again = _without_the_undetermined(replace(problem, cameras=cameras), settings, None)
    found = tuple(landmark for landmark in again.landmarks if landmark.kind == "check")
    checks = {t.target for t in problem.targets if t.check}
    left = tuple(f for f in again.findings if f.kind == "target-left-out" and f.subject in checks)
    return with_landmarks(with_findings(solution, left), found)


def _without_the_undetermined(
    problem: Problem, settings: SolverSettings, progress: Progress | None, part: Part = uncounted
) -> Solution:
    """The adjustment without the targets that it cannot determine, each of which is said."""
    left: list[Finding] = []
    while True:
        try:
            solution = _safely(problem, settings, progress, part)
            return with_findings(solution, tuple(left))
        except GeometryError as error:
            name = next((t.target for t in problem.targets if error.where == f"target {t.target}"), None)
            smaller = None if name is None else without_targets(problem, [name])
            if name is None or smaller is None:
                raise
            left.append(_left_out(name, error))
            problem = smaller


def _left_out(target: str, error: GeometryError) -> Finding:
    return Finding(
        kind="target-left-out",
        subject=target,
        words=f"{target} is left out, the others are solved: {error.seen}; expected {error.expected}",
        carried_by=error.advice,
    )


def _safely(problem: Problem, settings: SolverSettings, progress: Progress | None, part: Part) -> Solution:
    """`_solved`, whose mathematics may find no finite answer."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return _solved(problem, settings, progress, part)
    except (np.linalg.LinAlgError, FloatingPointError, OverflowError, ZeroDivisionError) as error:
        raise GeometryError(
            where=f"method {settings.method}",
            seen=f"equations that have no finite answer ({error})",
            expected="sightings and sigmas that determine motions, clocks and poses together",
            advice="look for cameras in one place, sigmas far larger than the scene, clocks that never meet",
        ) from error


def _solved(problem: Problem, settings: SolverSettings, progress: Progress | None, part: Part) -> Solution:
    with part("search"):
        seen = views(without_landmarks(problem))
        find_degeneracies(problem, settings, seen=seen)
        frames = with_rows(problem, pack(problem))
        starts = candidates(without_landmarks(problem), settings)
        renew = renewing(problem) if settings.method in RENEWING else None
    asked = Asked(
        problem=problem, settings=settings, frames=frames, starts=starts, progress=_counted(progress), renew=renew
    )
    compiled_descent.warm()
    with part("solver"):
        began = time.perf_counter()
        found = METHODS[settings.method](asked)
        seconds = time.perf_counter() - began
    with part("judge"):
        return _judged(problem, settings, found(), seconds, seen)


def _judged(
    problem: Problem, settings: SolverSettings, outcome: Outcome, seconds: float, seen: Mapping[str, View]
) -> Solution:
    """The record of what a method found, with what it leaves open and its verdict."""
    solution = solution_of(problem, settings, outcome, seconds)
    orders = {m.target: m.degree for m in solution.motions if m.kind == "polynomial"}
    covariance = solution.shared_covariance
    shared = None if covariance is None else (solution.shared_names, covariance)
    try:
        left_open = find_degeneracies(
            problem, settings, clocks=solution.clocks, orders=orders, seen=seen, shared=shared
        )
    except GeometryError as error:
        return _refused(problem, outcome, solution, error)
    findings = (*solution.findings, *left_open, *_low_weights(solution))
    return judged(problem, outcome, replace(solution, findings=findings))


def _refused(problem: Problem, outcome: Outcome, solution: Solution, error: GeometryError) -> Solution:
    """A solution that contradicts itself is called bad, with its culprits: what it says of geometry may be false.

    Raises the error where the solution fits.
    """
    try:
        found = judged(problem, outcome, replace(solution, findings=(*solution.findings, *_low_weights(solution))))
    except (np.linalg.LinAlgError, ValueError):
        raise error from None
    if found.verdict.grade != "bad":
        raise error
    return with_refusal(found, error)


def _low_weights(solution: Solution) -> tuple[Finding, ...]:
    """A finding for every camera of whose sightings more than a fifth hardly count."""
    names, low = np.array(solution.sightings.camera), solution.sightings.weight < LOW_WEIGHT
    found = []
    for name in dict.fromkeys(solution.sightings.camera):
        share = float(low[names == name].mean())
        if share > FIFTH:
            words = f"{100 * share:.0f} % of the sightings of {name} hardly count (weight below {LOW_WEIGHT})"
            found.append(Finding(kind="low-weights", subject=name, words=words))
    return tuple(found)


COMPILED = 26
"""About as many functions are compiled on the first solve of an installation that brings none."""


def how_compiled() -> str:
    """How the solver's loops are compiled: "ahead", "when called", or "no"; the least where some are otherwise."""
    modules = (_kernels.__name__, frame_sums.__module__)
    return min((how_module_compiled(name) for name in modules), key=("no", "when called", "ahead").index)


def make_ready(told: Callable[[int, int], None]) -> None:
    """Compiles what `solve` uses, or loads it from disk; `told` hears how many of how many functions have begun.

    It is only told where there is something to compile: not where the installation brings the loops compiled.
    """
    if how_compiled() != "when called":
        return
    begun: list[str] = []

    def say(name: str) -> None:
        begun.append(name)
        told(min(len(begun), COMPILED) - 1, COMPILED)

    with announced(say):
        compiled_descent.warm()
    if begun:
        told(COMPILED, COMPILED)


def _counted(progress: Progress | None) -> Progress | None:
    """Iterations counted through all stages of a method, each of which counts its own."""
    if progress is None:
        return None
    count = itertools.count(1)
    return lambda _, cost: progress(next(count), cost)


def _rows_renewing(problem: Problem) -> Renew | None:
    """Of methods whose clocks' rates are as given: only rows make their data depend on the point."""
    return renewing(problem) if any(has_rows(camera) for camera in problem.cameras) else None


def _intersection(asked: Asked) -> Finish:
    model, state = _paper_start(asked, given_offsets(asked.problem), {})
    model, state = intersected(model, state, _rows_renewing(asked.problem))
    here = linear(model, state)
    return partial(_paper_outcome, asked, Fit(model=model, linear=here, status="converged", iterations=1))


def _li(asked: Asked) -> Finish:
    model, state = _paper_start(asked, given_offsets(asked.problem), {})
    fit = li.alternate(model, state, LI_ROUNDS, asked.progress, _rows_renewing(asked.problem))
    return partial(_paper_outcome, asked, fit)


def _algorithm(asked: Asked) -> Finish:
    model, state = _paper_start(asked, asked.starts[0].offset_s, asked.starts[0].frame_rate)
    descent = Descent(max_iterations=asked.settings.max_iterations, progress=asked.progress, renew=asked.renew)
    small = EARLY if model.pose.free else SMALL
    return partial(_paper_outcome, asked, levenberg_marquardt(model, intersect(model, state), descent, small=small))


def _paper_start(asked: Asked, offset_s: Mapping[str, float], rate: Mapping[str, float]) -> tuple[Model, State]:
    """A model with the paper's residual in metres, at these clocks."""
    camera = first_camera(asked.problem, offset_s, rate)
    return first_model(
        asked.problem, asked.settings, metric(asked.frames), first_choice(asked.problem, asked.settings.method), camera
    )


def _paper_outcome(asked: Asked, fit: Fit) -> Outcome:
    """With the covariance that the residuals themselves suggest: the paper's metres have no sigma."""
    free = fit.model.order.n_band + fit.model.order.n_border + 3 * fit.model.frames.count * fit.model.pose.free
    redundancy = 2 * int(asked.frames.seen.sum()) - free
    factor = factorise(fit.linear.system)
    known = factor is not None and redundancy > 0
    observed = rolled(with_poses_of(asked.frames, fit.model.frames), fit.model, fit.state)
    return Outcome(
        model=fit.model, observed=observed, state=fit.state, status=fit.status, iterations=fit.iterations,
        cost=fit.cost, candidates=asked.starts, findings=_assumed_orders(asked.problem),
        plain=Inverse(factor=factor, scale=2 * fit.cost / redundancy) if known and factor is not None else None,
    )  # fmt: skip


def _assumed_orders(problem: Problem) -> tuple[Finding, ...]:
    """Only `map` has a likelihood that could choose an order."""
    return tuple(
        Finding(
            kind="motion-order",
            subject=t.target,
            words=f"{t.target} is given a motion of order {FIRST_ORDER}: only map can choose one",
        )
        for t in problem.targets
        if t.is_asked
    )


def _triangulation(asked: Asked) -> Finish:
    found = triangulate(asked.problem, asked.settings, asked.frames)
    return lambda: found


def _map(asked: Asked) -> Finish:
    found = map_estimation.adjust(
        asked.problem, asked.settings, asked.frames, asked.starts, asked.progress, asked.renew
    )
    return partial(map_estimation.outcome, found)


METHODS: dict[str, Callable[[Asked], Finish]] = {
    "triangulation": _triangulation,
    "intersection": _intersection,
    "li": _li,
    "algorithm-1": _algorithm,
    "algorithm-2": _algorithm,
    "map": _map,
}
