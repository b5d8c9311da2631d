"""`map`: the adjustment in its statistical form, and how it is started."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.records import Finding, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.bordered import factorise
from pipeline.solver.covariance import Inverse
from pipeline.solver.intersection import intersect_weighted
from pipeline.solver.layout import Frames
from pipeline.solver.levenberg import Fit, Progress, levenberg_marquardt
from pipeline.solver.results import Outcome
from pipeline.solver.start import MotionChoice, first_camera, first_choice, first_model, given_offsets

TRIED = 3
"""Offset candidates that are given a short adjustment each."""
SHORT = 12
"""Iterations of it."""
CLEARLY_WORSE = 10.0
"""Cost (half chi-square) by which the next best offsets must be worse not to be called ambiguous."""


def offsets_unknown(problem: Problem) -> bool:
    """Whether any camera's offset has to be searched for."""
    return any(c.offset_s is None for c in problem.cameras if c.camera != problem.reference_camera)


def candidates(problem: Problem, settings: SolverSettings) -> tuple[OffsetCandidate, ...]:
    """Where to start: what the problem gives, or what the global search finds, best first."""
    if offsets_unknown(problem):
        from pipeline.solver.search import search_offsets

        return search_offsets(problem, settings)
    return (OffsetCandidate(offset_s=given_offsets(problem), cost=0.0),)


def best_start(
    problem: Problem, settings: SolverSettings, begin: Callable[[OffsetCandidate], Fit]
) -> tuple[Fit, tuple[OffsetCandidate, ...], tuple[Finding, ...]]:
    """A short adjustment from each of the best candidates; the lowest cost goes on, all are reported."""
    found = candidates(problem, settings)
    if len(found) == 1:
        return begin(found[0]), found, ()
    fits = [begin(c) for c in found[:TRIED]]
    ranked = sorted(range(len(fits)), key=lambda i: fits[i].cost)
    reported = tuple(
        OffsetCandidate(offset_s=found[i].offset_s, cost=fits[i].cost, frame_rate=found[i].frame_rate) for i in ranked
    )
    return fits[ranked[0]], reported, ambiguous(reported)


def ambiguous(ranked: tuple[OffsetCandidate, ...]) -> tuple[Finding, ...]:
    """A finding where the second best offsets are not clearly worse than the best."""
    if len(ranked) < 2 or ranked[1].cost - ranked[0].cost > CLEARLY_WORSE:
        return ()
    other = ", ".join(f"{name} {value:+.2f} s" for name, value in ranked[1].offset_s.items())
    return (
        Finding(
            kind="ambiguous-offset",
            subject="",
            words=f"other time offsets fit nearly as well ({other}): the cost differs by only "
            f"{ranked[1].cost - ranked[0].cost:.1f}",
        ),
    )


def statistical_start(
    problem: Problem, settings: SolverSettings, frames: Frames, choice: MotionChoice, candidate: OffsetCandidate,
    iterations: int,
) -> Fit:  # fmt: skip
    """The motion by weighted intersection at a candidate's clocks, then some steps of the whole adjustment."""
    camera = first_camera(problem, candidate.offset_s, candidate.frame_rate)
    model, state = first_model(problem, settings, frames, choice, camera)
    return levenberg_marquardt(model, intersect_weighted(model, state), max_iterations=iterations)


def adjust(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None = None) -> Outcome:
    """The whole of `map`: start, adjustment, uncertainty."""
    choice = first_choice(problem)

    def begin(candidate: OffsetCandidate) -> Fit:
        return statistical_start(problem, settings, frames, choice, candidate, SHORT)

    fit, found, findings = best_start(problem, settings, begin)
    fit = levenberg_marquardt(fit.model, fit.state, max_iterations=settings.max_iterations, progress=progress)
    factor = factorise(fit.linear.system)
    return Outcome(
        model=fit.model, observed=frames, state=fit.state, status=fit.status, iterations=fit.iterations, cost=fit.cost,
        plain=None if factor is None else Inverse(factor=factor), findings=findings, candidates=found,
    )  # fmt: skip
