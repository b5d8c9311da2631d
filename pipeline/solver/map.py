"""`map`: the adjustment in its statistical form, and how it is started."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.arrays import Floats
from pipeline.records import Finding, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.bordered import factorise
from pipeline.solver.clusters import clusters
from pipeline.solver.covariance import Inverse, sandwich
from pipeline.solver.drifting import drifting, with_drift
from pipeline.solver.elimination import HUBER, NONE, Loss
from pipeline.solver.intersection import intersect, intersect_weighted
from pipeline.solver.layout import Frames
from pipeline.solver.levenberg import Fit, Progress, levenberg_marquardt
from pipeline.solver.model import Model, State
from pipeline.solver.residuals import linearise
from pipeline.solver.results import Outcome
from pipeline.solver.start import MotionChoice, first_camera, first_choice, first_model, given_offsets
from pipeline.solver.strength import renewed_jerk, renewed_walk, with_strengths
from pipeline.solver.timing import FOCAL, common_time_s

TRIED = 3
"""Offset candidates that are given a short adjustment each."""
TRIAL = 25
"""Iterations of it."""
STAGES, SHORT, COARSE, FAR = 4, 8, 1e-2, 2.5
ROUNDS, SETTLED = 4, 0.05
"""Rounds in which the priors' strengths are estimated, and the relative change that ends them."""
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
    problem: Problem, settings: SolverSettings, begin: Callable[[OffsetCandidate, int], Fit]
) -> tuple[Fit, tuple[OffsetCandidate, ...], tuple[Finding, ...]]:
    """A short adjustment from each of the best candidates; the lowest cost goes on, all are reported."""
    found = candidates(problem, settings)
    if len(found) == 1:
        return begin(found[0], settings.max_iterations), found, ()
    fits = [begin(c, TRIAL) for c in found[:TRIED]]
    ranked = sorted(range(len(fits)), key=lambda i: fits[i].cost)
    reported = tuple(
        OffsetCandidate(offset_s=found[i].offset_s, cost=fits[i].cost, frame_rate=found[i].frame_rate) for i in ranked
    )
    best = fits[ranked[0]]
    if best.status != "converged":
        best = levenberg_marquardt(best.model, best.state, max_iterations=settings.max_iterations)
    return best, reported, ambiguous(reported)


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
    problem: Problem, settings: SolverSettings, frames: Frames, choice: MotionChoice, candidate: OffsetCandidate
) -> tuple[Model, State]:
    """The motion by weighted intersection at a candidate's clocks, or by plain intersection where that is enough."""
    camera = first_camera(problem, candidate.offset_s, candidate.frame_rate)
    model, state = first_model(problem, settings, frames, choice, camera)
    if "spline" in choice.kinds:
        return model, intersect_weighted(model, state)
    return model, intersect(model, state)


def graduated(model: Model, state: State, iterations: int, progress: Progress | None = None) -> Fit:
    """Levenberg-Marquardt from far: the robust loss bends late at first, so that errors of the start are no outliers.

    Each stage bends at `FAR` times the median residual that it finds, until that is nearly the loss' own bend.
    """
    wanted, done = model.loss, 0
    for _ in range(STAGES if wanted.kind != NONE else 0):
        bend = FAR * float(np.median(residual_lengths(model, state)))
        if bend <= 1.5 * wanted.bend:
            break
        eased = replace(model, loss=Loss(kind=HUBER, bend=bend))
        fit = levenberg_marquardt(eased, state, max_iterations=SHORT, small=COARSE, progress=progress)
        state, done = fit.state, done + fit.iterations
    fit = levenberg_marquardt(model, state, max_iterations=max(1, iterations - done), progress=progress)
    return replace(fit, iterations=fit.iterations + done)


def residual_lengths(model: Model, state: State) -> Floats:
    """(m,) length of every sighting's residual in sigmas."""
    return np.asarray(np.linalg.norm(residuals(model, state)[model.frames.seen], axis=-1))


def residuals(model: Model, state: State) -> Floats:
    """(F, N, 2) residuals in sigmas."""
    frames = model.frames
    time = common_time_s(frames, model.drift, state.camera, state.deviation)
    error = state.camera[frames.camera, :6] + model.pose.spread[frames.camera] * state.own
    position = model.basis.position(time, state.coefficients)
    return linearise(frames, slice(None), position, error, state.camera[frames.camera, FOCAL]).residual


def with_estimated_priors(fit: Fit, iterations: int, progress: Progress | None = None) -> Fit:
    """Rounds of estimating how strong the priors of splines and drifting clocks are, and of adjusting with that."""
    model = fit.model
    if not model.drift.count and all(t.kind == "polynomial" for t in model.basis.targets):
        return fit
    for _ in range(ROUNDS):
        factor = factorise(fit.linear.system)
        if factor is None:
            return fit
        covariance = Inverse(factor=factor)
        jerk = renewed_jerk(fit.model, fit.state, covariance)
        walk = renewed_walk(fit.model, fit.state, covariance)
        before = np.concatenate([fit.model.priors.jerk.ravel(), fit.model.priors.drift_rate])
        model = with_strengths(fit.model, jerk, walk)
        again = levenberg_marquardt(model, fit.state, max_iterations=iterations, progress=progress)
        fit = replace(again, iterations=fit.iterations + again.iterations)
        change = np.abs(np.concatenate([jerk.ravel(), walk]) - before) / np.maximum(before, 1e-12)
        if np.median(change) < SETTLED:
            break
    return fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """The optimum, before its uncertainty is worked out."""

    fit: Fit
    findings: tuple[Finding, ...] = ()
    candidates: tuple[OffsetCandidate, ...] = ()


def adjust(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None = None) -> Adjusted:
    """The whole of `map` up to the optimum: start, priors' strengths, drifting clocks."""
    choice = first_choice(problem)

    def begin(candidate: OffsetCandidate, iterations: int) -> Fit:
        model, state = statistical_start(problem, settings, frames, choice, candidate)
        return graduated(model, state, iterations, progress)

    fit, found, findings = best_start(problem, settings, begin)
    fit = with_estimated_priors(fit, settings.max_iterations, progress)
    drifts, said = drifting(problem, fit.model, fit.state)
    if drifts:
        model, state = with_drift(fit.model, fit.state, drifts)
        again = levenberg_marquardt(model, state, max_iterations=settings.max_iterations, progress=progress)
        again = with_estimated_priors(again, settings.max_iterations, progress)
        fit = replace(again, iterations=fit.iterations + again.iterations)
    return Adjusted(fit=fit, findings=(*findings, *said), candidates=found)


def outcome(frames: Frames, found: Adjusted) -> Outcome:
    """The adjustment with its uncertainty, plain and cluster-robust."""
    fit = found.fit
    factor = factorise(fit.linear.system)
    robust = None
    if factor is not None:
        cluster = clusters(fit.model, fit.state, residuals(fit.model, fit.state))
        robust = sandwich(fit.model, fit.state, factor, cluster)
    return Outcome(
        model=fit.model, observed=frames, state=fit.state, status=fit.status, iterations=fit.iterations, cost=fit.cost,
        plain=None if factor is None else Inverse(factor=factor), robust=robust,
        findings=found.findings, candidates=found.candidates,
    )  # fmt: skip
