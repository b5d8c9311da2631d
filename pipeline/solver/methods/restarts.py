"""Other starts, where the misfit says that an optimum is not the right one, or where the iteration did not end.

An adjustment of clocks, biases and motions together has more than one optimum. That residuals are larger than their
sigmas allow says that this one is wrong, or the sigmas are; other starts tell which:

    other offsets        candidates of the search that were not tried yet, and those of the ways to search not used yet
    parabolas first      every motion that the data shall say is one of order 2 until clocks and biases have settled
    rates held first     frame rates stay as given until everything else has settled

The best is taken; how the others ended is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Bools
from calibration.foundation.errors import GeometryError
from pipeline.records import Finding, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.adjustment.levenberg_marquardt import Descent, Fit, levenberg_marquardt
from pipeline.solver.methods.goodness_of_fit import data_cost, misfit, redundancy_left
from pipeline.solver.methods.initialisation import cleared, differ, statistical_start
from pipeline.solver.methods.lone_stretches import Lone
from pipeline.solver.methods.parameters import MotionChoice, basis_at, with_basis
from pipeline.solver.observation.clocks import SCALE, common_time_s
from pipeline.solver.observation.observations import Frames
from pipeline.solver.observation.selection import without_landmarks
from pipeline.solver.offset_search.search import further_offsets

DOUBTED, SIGMAS = 1.25, 6.0
"""Chi-square per degree of freedom, and how many sigmas of it, from which on other starts are tried. Doubling the first
finds wrong optima later; halving it tries other starts in flights whose sigmas are a little too small."""
MOST = 6
"""Other starts at most: each costs about what the first one did."""
FEW = 40
"""Iterations of the first part of a start."""
NO_FINITE_ANSWER = (np.linalg.LinAlgError, FloatingPointError, OverflowError, ZeroDivisionError)
"""What mathematics raise where a scene has shrunk to a point, or sigmas hold nothing."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """One way to begin: in words, and the adjustment that it leads to."""

    words: str
    run: Callable[[], Fit]


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """An adjustment with motions, clocks' drifts, wandering poses and strengths of priors as the data say, and why.

    choice  motions in force; alone: sightings that no other camera's is near to; None where it failed
    """

    fit: Fit
    findings: tuple[Finding, ...] = ()
    choice: MotionChoice | None = None
    alone: Lone | None = None

    @property
    def lone(self) -> Bools | None:
        """(F, N) sightings that no other camera's is near to."""
        return None if self.alone is None else self.alone.sighting


@dataclass(frozen=True, kw_only=True, eq=False)
class Beginning:
    """What every start needs."""

    problem: Problem
    settings: SolverSettings
    frames: Frames
    choice: MotionChoice
    descent: Descent
    small: float


def is_doubtful(fit: Fit) -> bool:
    """Whether an optimum is not to be believed without a look at others."""
    factor, sigmas = misfit(fit)
    return fit.status != "converged" or (factor > DOUBTED and sigmas > SIGMAS)


def looks_alone(fit: Fit) -> bool:
    """Whether some camera looks when no other does: nothing contradicts it then, so that it fits whatever it says."""
    frames = fit.model.frames
    time = common_time_s(frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    seen: Bools = np.asarray(frames.seen.any(axis=1))
    ends = []
    for c in range(len(frames.cameras)):
        own = time[frames.of(c)][seen[frames.of(c)]]
        ends.append((float(own.min()), float(own.max())) if len(own) else (-np.inf, np.inf))
    return len(ends) > 1 and any(
        all(low > b or high < a for j, (a, b) in enumerate(ends) if j != i) for i, (low, high) in enumerate(ends)
    )


def best_of(
    first: Settled, beginning: Beginning, tried: tuple[OffsetCandidate, ...], left: tuple[OffsetCandidate, ...],
    settle: Callable[[Fit], Settled],
) -> tuple[Settled, tuple[Finding, ...]]:  # fmt: skip
    """The best of `first` and the adjustments from other starts, and how they ended, where `first` is doubtful."""
    if not is_doubtful(first.fit):
        return first, ()
    ends, failed = [("the best offsets", first)], []
    for start in _others(beginning, tried, left):
        try:
            ends.append((start.words, settle(start.run())))
        except (GeometryError, *NO_FINITE_ANSWER):
            failed.append(start.words)
            continue
        if not is_doubtful(ends[-1][1].fit):
            break
    fits = [(words, end.fit) for words, end in ends]
    best = min(
        range(len(ends)),
        key=lambda i: (looks_alone(fits[i][1]), is_doubtful(fits[i][1]), _worth(fits[i][1]), i),
    )
    fit = replace(fits[best][1], iterations=sum(f.iterations for _, f in fits))
    return replace(ends[best][1], fit=fit), (_told(fits, best, failed),)


def _worth(fit: Fit) -> float:
    """What is compared: the data's cost, and one for every unknown that they decide."""
    return data_cost(fit) - redundancy_left(fit)


def _others(
    beginning: Beginning, tried: tuple[OffsetCandidate, ...], left: tuple[OffsetCandidate, ...]
) -> Iterator[Start]:
    count = 0
    for candidate in tried:
        for words, run in (("parabolas first", _parabolas_first), ("frame rates held first", _rates_held_first)):
            if count < MOST - 2 and _applies(beginning, words):
                count += 1
                yield Start(words=words + _at(candidate), run=lambda run=run, c=candidate: run(beginning, c))  # type: ignore[misc]
    further = (*left, *further_offsets(without_landmarks(beginning.problem), beginning.settings))
    for candidate in further[: MOST - count]:
        yield Start(words="other offsets" + _at(candidate), run=lambda c=candidate: _plainly(beginning, c))  # type: ignore[misc]


def _applies(beginning: Beginning, words: str) -> bool:
    if words == "parabolas first":
        return any(t.is_asked for t in beginning.problem.targets)
    return beginning.settings.refine_frame_rate and len(beginning.problem.cameras) > 1


def _at(candidate: OffsetCandidate) -> str:
    values = [f"{name} {value:+.2f} s" for name, value in candidate.offset_s.items() if value]
    return f" ({', '.join(values)})" if values else ""


def _plainly(b: Beginning, candidate: OffsetCandidate) -> Fit:
    model, state = statistical_start(b.problem, b.settings, b.frames, b.choice, candidate)
    return cleared(model, state, b.descent, b.small)


def parabolas(b: Beginning, candidates: Sequence[OffsetCandidate]) -> Fit:
    """The best adjustment, from these offsets, in which every motion that the data shall say is of order 2."""
    return min((_parabolas(b, candidate) for candidate in candidates), key=lambda fit: fit.cost)


def _parabolas(b: Beginning, candidate: OffsetCandidate) -> Fit:
    asked = [t.is_asked for t in b.problem.targets]
    simple = replace(
        b.choice,
        kinds=tuple("polynomial" if a else kind for a, kind in zip(asked, b.choice.kinds, strict=True)),
        orders=tuple(2 if a else order for a, order in zip(asked, b.choice.orders, strict=True)),
    )
    model, state = statistical_start(b.problem, b.settings, b.frames, simple, candidate)
    return cleared(model, state, replace(b.descent, max_iterations=FEW), b.small)


def _parabolas_first(b: Beginning, candidate: OffsetCandidate) -> Fit:
    fit = _parabolas(b, candidate)
    time = common_time_s(fit.model.frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    model, state = with_basis(fit.model, fit.state, basis_at(fit.model.frames, b.choice, time))
    found = levenberg_marquardt(model, state, b.descent, small=b.small)
    return replace(found, iterations=fit.iterations + found.iterations)


def _rates_held_first(b: Beginning, candidate: OffsetCandidate) -> Fit:
    model, state = statistical_start(b.problem, b.settings, b.frames, b.choice, replace(candidate, frame_rate={}))
    free = model.priors.camera_free
    held = free.copy()
    held[:, SCALE] = False
    fit = cleared(
        model.changed(priors=replace(model.priors, camera_free=held)), state,
        replace(b.descent, max_iterations=FEW), b.small,
    )  # fmt: skip
    freed = fit.model.changed(priors=replace(fit.model.priors, camera_free=free))
    found = levenberg_marquardt(freed, fit.state, b.descent, small=b.small)
    return replace(found, iterations=fit.iterations + found.iterations)


def _told(ends: list[tuple[str, Fit]], best: int, failed: list[str]) -> Finding:
    parts = []
    for i, (words, fit) in enumerate(ends):
        same = "" if i == best else ", same clocks" if not differ(fit, ends[best][1]) else ", other clocks"
        state = "" if fit.status == "converged" else f", {fit.status}"
        parts.append(f"{words}: {misfit(fit)[0]:.2f}{state}{same}")
    parts += [f"{words}: no finite answer" for words in failed]
    return Finding(
        kind="other-starts",
        subject="",
        words="the first optimum was doubtful, so others were looked for (chi-square per degree of freedom): "
        + "; ".join(parts)
        + f". Taken: {ends[best][0]}",
    )
