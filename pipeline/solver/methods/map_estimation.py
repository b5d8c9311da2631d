"""`map`: the adjustment in its statistical form, from the candidates for the offsets to the covariance.

start       a short adjustment from each of the best candidates
orders      of polynomials that the data shall choose
strengths   of the priors of splines
clocks      that drift, by order or because the data say so
covariance  plain and cluster-robust
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.errors import GeometryError
from pipeline.records import Finding, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.levenberg_marquardt import SMALL, Descent, Fit, Progress, levenberg_marquardt
from pipeline.solver.adjustment.log_poses import Renew
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.clock_drift import drifting, with_drift
from pipeline.solver.methods.initialisation import (
    TRIED,
    best_start,
    cleared,
    left_out,
    residual_lengths,
    residuals,
    statistical_start,
)
from pipeline.solver.methods.known_motions import ground_gaps, renewed_known
from pipeline.solver.methods.lone_stretches import Lone, confined, none_alone, told
from pipeline.solver.methods.model_selection import choose_motions
from pipeline.solver.methods.parameters import BEND, MotionChoice, first_choice
from pipeline.solver.methods.restarts import NO_FINITE_ANSWER, Beginning, Settled, best_of, is_doubtful, parabolas
from pipeline.solver.methods.results import Outcome
from pipeline.solver.methods.simple_motions import simple_motions
from pipeline.solver.methods.variance_components import renewed_jerk, renewed_walk, with_strengths
from pipeline.solver.methods.wandering_poses import with_wandering_poses
from pipeline.solver.observation.observations import Frames
from pipeline.solver.uncertainty.clusters import clusters
from pipeline.solver.uncertainty.covariance import Inverse, sandwich

ROUNDS, SETTLED = 4, 0.05
"""Rounds in which the priors' strengths are estimated, and the relative change that ends them."""
WARM, ROUGHLY, FINELY = 1e-9, 1e-5, 1e-7
"""Damping of an adjustment that begins near its optimum; the relative change of the cost that ends one whose optimum is
still going to move, and that ends the last one with splines: a thousandth of a unit of cost, a thirtieth of a sigma."""


BRIEF = 30
"""Iterations of an adjustment that only has to tell whether it fits: what does fit takes ten."""
MANY_OUTLIERS = 0.1
"""Share of sightings beyond twice where Huber's loss bends from which on Cauchy's takes its place, where the median
sighting fits (`FITTING` sigmas): twice as many bias what Huber's finds by about a sigma of one sighting."""
FITTING = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """The optimum, before its uncertainty is worked out."""

    fit: Fit
    findings: tuple[Finding, ...] = ()
    candidates: tuple[OffsetCandidate, ...] = ()


def adjust(
    problem: Problem, settings: SolverSettings, frames: Frames, found: tuple[OffsetCandidate, ...],
    progress: Progress | None = None, renew: Renew | None = None,
) -> Adjusted:  # fmt: skip
    """The whole of `map` up to the optimum, from the offsets `found`; `renew` is `renewing(problem)`."""
    descent = Descent(max_iterations=settings.max_iterations, progress=progress, renew=renew)
    choice = first_choice(problem, settings.method)
    small = ROUGHLY if "spline" in choice.kinds else SMALL

    def begin(candidate: OffsetCandidate, iterations: int) -> Fit:
        model, state = statistical_start(problem, settings, frames, choice, candidate)
        return cleared(model, state, replace(descent, max_iterations=iterations), small)

    asked = any(t.is_asked for t in problem.targets)

    def warm(model: Model, state: State) -> Fit:
        return levenberg_marquardt(model, state, replace(descent, damping=WARM), small=ROUGHLY)

    def finely(model: Model, state: State) -> Fit:
        return levenberg_marquardt(model, state, replace(descent, damping=WARM))

    def briefly(model: Model, state: State) -> Fit:
        short = replace(descent, damping=WARM, max_iterations=BRIEF)
        return levenberg_marquardt(model, state, short, small=ROUGHLY)

    def simple() -> Fit:
        return parabolas(beginning, found[:TRIED])

    def settle(fit: Fit) -> Settled:
        if fit.status == "iteration-limit" and len(found) > 1:
            fit = continued(fit, descent)
        fit = along_the_ground(problem, fit, warm)
        fit, outliers = with_bounded_loss(fit, settings, descent)
        alone = none_alone(fit.model.frames)
        if asked or "spline" in choice.kinds:
            fit, alone = without_lone_stretches(fit, choice, warm)
        fit = with_estimated_priors(fit, descent, rounds=ROUNDS if asked else 1, even=asked)
        fit, clocks = with_drifting_clocks(problem, fit, descent)
        fit, wanders = with_wandering_poses(problem, fit, warm)
        chosen = choose_motions(problem, choice, fit, finely, simple, alone)
        fit = along_the_ground(problem, with_estimated_priors(chosen.fit, descent), finely)
        if has_estimated_priors(fit):
            fit = continued(fit, replace(descent, damping=WARM), small=FINELY)
        findings = (*outliers, *chosen.findings, *clocks, *wanders, *told(alone, fit))
        return Settled(fit=fit, findings=findings, choice=chosen.choice, alone=alone)

    beginning = Beginning(
        problem=problem, settings=settings, frames=frames, choice=choice, descent=descent, small=small
    )
    fit, ranked, ambiguous = best_start(found, begin, settings.max_iterations)
    settled, restarts = best_of(_settled(fit, settle), beginning, found[:1], found[TRIED:], settle)
    suspected = () if is_doubtful(settled.fit) else _suspected(problem, settled, briefly)
    return Adjusted(
        fit=settled.fit, candidates=ranked,
        findings=(
            *ambiguous, *restarts, *settled.findings, *suspected,
            *left_out(frames, settled.fit.model.frames, settled.lone),
            *ground_gaps(problem, settled.fit.model, settled.fit.state),
        ),
    )  # fmt: skip


def _settled(fit: Fit, settle: Callable[[Fit], Settled]) -> Settled:
    """`fit` settled, or as it is and not to be believed, so that other starts are tried."""
    try:
        return settle(fit)
    except NO_FINITE_ANSWER:
        return Settled(fit=replace(fit, status="stalled"))


def _suspected(problem: Problem, settled: Settled, descend: Callable[[Model, State], Fit]) -> tuple[Finding, ...]:
    """Whether free motions may be what poses did; nothing where that has no finite answer."""
    if settled.choice is None or settled.alone is None:
        return ()
    try:
        return simple_motions(problem, settled.choice, settled.fit, descend, settled.alone)
    except (GeometryError, *NO_FINITE_ANSWER):
        return ()


def without_lone_stretches(fit: Fit, choice: MotionChoice, descend: Callable[[Model, State], Fit]) -> tuple[Fit, Lone]:
    """The adjustment without what one camera alone sees of splines; see `lone_stretches`."""
    model, state, alone = confined(fit.model, fit.state, choice)
    if model is fit.model:
        return fit, alone
    again = descend(model, state)
    return replace(again, iterations=fit.iterations + again.iterations), alone


def with_bounded_loss(fit: Fit, settings: SolverSettings, descent: Descent) -> tuple[Fit, tuple[Finding, ...]]:
    """With Cauchy's loss instead of Huber's where many sightings are far off: Huber's lets each of them pull on."""
    if settings.robust != "huber":
        return fit, ()
    length = residual_lengths(fit.model, fit.state)
    share = float((length > 2 * fit.model.loss.bend).mean())
    if share < MANY_OUTLIERS or np.median(length) > FITTING:
        return fit, ()
    bounded = levenberg_marquardt(replace(fit.model, loss=BEND["cauchy"]), fit.state, descent)
    words = f"{100 * share:.0f} % of the sightings are outliers, so that Cauchy's loss is taken instead of Huber's"
    again = replace(bounded, iterations=fit.iterations + bounded.iterations)
    return again, (Finding(kind="many-outliers", subject="", words=words, carried_by="solve.robust"),)


def along_the_ground(problem: Problem, fit: Fit, descend: Callable[[Model, State], Fit]) -> Fit:
    """The adjustment with the ground's rows made anew along the motions; the same where nothing is on the ground."""
    model = renewed_known(problem, fit.model, fit.state)
    if model is fit.model:
        return fit
    again = descend(model, fit.state)
    return replace(again, iterations=fit.iterations + again.iterations)


def continued(fit: Fit, descent: Descent, small: float = SMALL) -> Fit:
    """More iterations from where a fit ended."""
    again = levenberg_marquardt(fit.model, fit.state, descent, small=small, begun=fit.linear)
    return replace(again, iterations=fit.iterations + again.iterations)


def has_estimated_priors(fit: Fit) -> bool:
    """Whether there are splines or drifting clocks, whose priors' strengths the data say."""
    return fit.model.drift.count > 0 or any(t.kind != "polynomial" for t in fit.model.basis.targets)


def with_estimated_priors(fit: Fit, descent: Descent, rounds: int = ROUNDS, *, even: bool = False) -> Fit:
    """Rounds of estimating how strong the priors of splines and drifting clocks are, and of roughly adjusting."""
    if not has_estimated_priors(fit):
        return fit
    for _ in range(rounds):
        factor = factorise(fit.linear.system)
        if factor is None:
            return fit
        covariance = Inverse(factor=factor)
        jerk = renewed_jerk(fit.model, fit.state, covariance, even=even)
        walk = renewed_walk(fit.model, fit.state, covariance)
        before = np.concatenate([fit.model.priors.jerk.ravel(), fit.model.priors.drift_rate])
        stronger = replace(fit, model=with_strengths(fit.model, jerk, walk))
        fit = continued(stronger, replace(descent, damping=WARM), small=ROUGHLY)
        change = np.abs(np.concatenate([jerk.ravel(), walk]) - before) / np.maximum(before, 1e-12)
        if np.median(change) < SETTLED:
            break
    return fit


def with_drifting_clocks(problem: Problem, fit: Fit, descent: Descent) -> tuple[Fit, tuple[Finding, ...]]:
    """The adjustment again, with deviations of the clocks that drift; and why each clock is taken as it is."""
    cameras, reasons = drifting(problem, fit.model, fit.state)
    if not cameras:
        return fit, reasons
    model, state = with_drift(fit.model, fit.state, cameras)
    roughly = levenberg_marquardt(model, state, replace(descent, damping=WARM), small=ROUGHLY)
    return replace(roughly, iterations=fit.iterations + roughly.iterations), reasons


def outcome(found: Adjusted) -> Outcome:
    """The adjustment with its uncertainty, plain and cluster-robust."""
    fit = found.fit
    factor, plain, robust = factorise(fit.linear.system), None, None
    if factor is not None:
        plain = Inverse(factor=factor)
        cluster = clusters(fit.model, fit.state, residuals(fit.model, fit.state))
        robust = sandwich(fit.model, fit.state, plain, fit.linear.system, cluster)
    return Outcome(
        model=fit.model, observed=fit.model.frames, state=fit.state, status=fit.status,
        iterations=fit.iterations, cost=fit.cost,
        plain=plain, robust=robust,
        findings=found.findings, candidates=found.candidates,
    )  # fmt: skip
