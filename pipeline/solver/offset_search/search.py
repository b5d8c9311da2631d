"""Global search of time offsets: nothing known of the clocks, no start needed.

Common time of camera c is t = s_c tau + beta_c with tau its video time and s_c = nominal rate / alpha_c (paper eq. 2).
Cameras are set one after the other, the reference first, then always the one that shares most sightings with those
already set (so a camera that shares no target with the reference is reached through others). For each:

    1. sweep   a cost for every offset and rate on a grid; its local minima
    2. polish  each minimum downhill together with all cameras set so far: clocks, constant rotations and shifts;
               roughly first, then the best of them with all their sightings
    3. keep    the few best whole hypotheses (beam)

Two costs do this: `crossing` needs no model of the motion (splines, long flights), `polynomial` fits the
motion, which is linear once time is known (variable projection), and gets far more out of short noisy flights.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from calibration.foundation.errors import GeometryError
from pipeline.records import CameraInput, OffsetCandidate, Problem, SolverSettings
from pipeline.solver.offset_search.crossing import ClockPrior, Hypothesis
from pipeline.solver.offset_search.crossing import polish as polish_crossing
from pipeline.solver.offset_search.polynomial import sweep_polynomial
from pipeline.solver.offset_search.polynomial_polish import polish_polynomial
from pipeline.solver.offset_search.sweep import ClockGuess, ClockRange, SetCamera, sweep
from pipeline.solver.offset_search.views import View, views

ROUGH = 0.25
"""Share of the sightings that the first polish uses."""
GUESSES = 8
"""Minima of the sweep that are polished."""
BEAM = 4
"""Whole hypotheses that are carried on."""
KEPT = 6
"""Candidates that are returned, at most."""
SAME_S = 0.25
"""Clocks closer than this at mid-track are one candidate."""
CLEAR = 4.6
"""Half chi-square by which the best candidate must beat the next: a likelihood ratio of 100."""
WIDEST_CLOCK_SCALE = 0.1
FITS = 2.0
"""Chi-square per equation (median frame) up to which polynomials of a guessed order are taken to fit."""
HOPELESS = 20.0
"""Chi-square per equation of the best roughly polished guess from which on polynomials of a guessed order are given up:
ten times what fits, so that no better polishing can make up for it."""
TOGETHER = 0.1
"""Share of the shorter video in which cameras must look together where a motion's order is guessed: two videos that do
not overlap fit a guess better than two that do, since nothing contradicts it. Half as much lets hardly a second of a
short video decide; twice as much loses videos that overlap by a sixth."""
SHORT_S = 60.0
"""Tracks up to this long are tried with polynomials where the order of a motion is not known."""
WEAK_S = 0.08
"""Sigma from which on an offset counts as weak."""
NEAR_S = 10.0
"""How far a given offset without a sigma is trusted."""

ShareDone = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class _Cost:
    """One way to judge clocks: coarse guesses for a new camera, and the polishing of a whole hypothesis; it is given up
    where the best rough misfit is beyond `hopeless`. Clocks must make cameras look together for the share `overlap`."""

    sweep: Callable[[View, Sequence[SetCamera], ClockRange, int], tuple[ClockGuess, ...]]
    polish: Callable[[Sequence[View], Sequence[tuple[float, float]], Sequence[ClockPrior | None], float], Hypothesis]
    hopeless: float = math.inf
    overlap: float = 0.0


def search_offsets(
    problem: Problem, settings: SolverSettings, *, progress: ShareDone | None = None
) -> tuple[OffsetCandidate, ...]:
    """Time offsets and frame rates of every camera, best first; several, so that a near tie can be seen and said.

    Offsets are looked for within +- `settings.search_s` where nothing is known of them, else within five sigmas of
    the camera's `offset_s`; frame rates within 10 % of the given ones unless they are held. Sign: t = f / alpha + beta
    (paper eq. 2), beta 0 for the reference camera. Costs are half chi-squares of the same sightings and compare with
    each other, not with the cost of a solution. `progress` is called with the share done, 0 to 1.

    Raises GeometryError where a camera shares no target, or no time, with the others.
    """
    seen = views(problem)
    order = setting_order(problem, seen)
    priors = {c.camera: _prior(c, settings, problem.reference_camera) for c in problem.cameras}
    rates = {c.camera: c.frame_rate for c in problem.cameras}
    costs = _costs(problem, seen)
    for cost in costs:
        found = _search(seen, order, priors, cost, progress)
        if found and found[0].misfit <= FITS:
            break
    return tuple(_candidate(fit, rates, problem) for fit in found)


def further_offsets(problem: Problem, settings: SolverSettings) -> tuple[OffsetCandidate, ...]:
    """What the ways to judge clocks find that `search_offsets` does not come to; none where nothing is searched."""
    others = [c for c in problem.cameras if c.camera != problem.reference_camera]
    if all(c.offset_s is not None for c in others):
        return ()
    seen = views(problem)
    order = setting_order(problem, seen)
    priors = {c.camera: _prior(c, settings, problem.reference_camera) for c in problem.cameras}
    rates = {c.camera: c.frame_rate for c in problem.cameras}
    found = [_search(seen, order, priors, cost, None)[:2] for cost in _costs(problem, seen)[1:]]
    return tuple(_candidate(fit, rates, problem) for fits in found for fit in fits)


CROSSING = _Cost(sweep=sweep, polish=polish_crossing)


def _search(
    seen: Mapping[str, View],
    order: Sequence[str],
    priors: Mapping[str, ClockPrior | None],
    cost: _Cost,
    progress: ShareDone | None,
) -> list[Hypothesis]:
    """Whole hypotheses by one way to judge them, best first; none where it is given up."""
    beam = [Hypothesis(clock={order[0]: (0.0, 1.0)}, cost=0.0)]
    others: list[tuple[str, Hypothesis]] = []
    for done, name in enumerate(order[1:], start=1):
        beam = _extended(seen, priors, beam, name, cost)
        if not beam:
            return []
        others += [(name, fit) for fit in (beam[1:] if name == order[-1] else beam[1:2])]
        beam = _worth_carrying(beam)
        if progress is not None:
            progress(done / (len(order) - 1))
    return _distinct([*beam, *_alternatives(beam[0], others, seen, priors, cost)], seen)[:KEPT]


def _costs(problem: Problem, seen: Mapping[str, View]) -> list[_Cost]:
    """Ways to judge clocks, in turn until one fits: fitted polynomials where that is how targets move, else crossing.

    A motion whose order the data shall say is tried as a parabola and as a polynomial of order four, if it is short.
    """
    if any(t.motion == "spline" for t in problem.targets):
        return [CROSSING]
    known = {t.target: 0 if t.order == "auto" else int(t.order) for t in problem.targets}
    auto = [t.target for t in problem.targets if t.is_asked]
    if not auto:
        return [_polynomial_cost(known)]
    if max((v.span_s[1] - v.span_s[0] for v in seen.values() if v.tracks), default=0.0) > SHORT_S:
        return [CROSSING]
    guessed = ({**known, **dict.fromkeys(auto, k)} for k in (2, 4))
    return [replace(_polynomial_cost(orders, TOGETHER), hopeless=HOPELESS) for orders in guessed] + [CROSSING]


def _polynomial_cost(orders: Mapping[str, int], overlap: float = 0.0) -> _Cost:
    return _Cost(
        overlap=overlap,
        sweep=partial(sweep_polynomial, orders=orders, overlap=overlap),
        polish=partial(polish_polynomial, orders=orders),
    )


def setting_order(problem: Problem, seen: Mapping[str, View]) -> list[str]:
    """Names of all cameras, the reference first, each sharing targets with one before it, most sightings first.

    Raises GeometryError where a camera cannot be reached.
    """
    order = [problem.reference_camera]
    waiting = [c.camera for c in problem.cameras if c.camera != problem.reference_camera]
    while waiting:
        shared = {name: _shared_sightings(seen[name], [seen[o] for o in order]) for name in waiting}
        best = max(waiting, key=lambda name: shared[name])
        if shared[best] == 0:
            raise _nothing_shared(best, order, seen)
        order.append(best)
        waiting.remove(best)
    return order


def _shared_sightings(new: View, placed: Sequence[View]) -> int:
    return sum(
        min(len(track), max((len(p.tracks[target]) for p in placed if target in p.tracks), default=0))
        for target, track in new.tracks.items()
    )


def _nothing_shared(camera: str, placed: Sequence[str], seen: Mapping[str, View]) -> GeometryError:
    sees = ", ".join(seen[camera].tracks) or "nothing (at least four sightings of a target are needed)"
    others = ", ".join(sorted({t for name in placed for t in seen[name].tracks})) or "nothing"
    return GeometryError(
        where=f"camera {camera}",
        seen=f"it sees {sees}, while {', '.join(placed)} see {others}",
        expected="at least one target in common, directly or through a third camera",
        advice="mark a common target in both videos (same target name), or leave the camera out",
    )


def _no_overlap(camera: str, placed: Sequence[str], allowed: ClockRange) -> GeometryError:
    return GeometryError(
        where=f"camera {camera}",
        seen=f"no offset from {allowed.low_s:.1f} s to {allowed.high_s:.1f} s lets it see a target at a time when "
        f"{', '.join(placed)} see it",
        expected="sightings of a common target that overlap in time",
        advice="give offset_s, or search further, or track the target for longer",
    )


def _prior(camera: CameraInput, settings: SolverSettings, reference: str) -> ClockPrior | None:
    """What is known of a clock; None for the reference, whose clock is common time."""
    if camera.camera == reference:
        return None
    sigma = camera.sigma
    free = settings.refine_frame_rate and sigma.frame_rate > 0
    clock_scale = min(WIDEST_CLOCK_SCALE, 20 * sigma.frame_rate) if free else 0.0
    width = settings.search_s
    offset_sigma = None
    if camera.offset_s is not None:
        offset_sigma = None if sigma.offset_s is None else max(sigma.offset_s, 1e-4)
        width = NEAR_S if offset_sigma is None else max(5 * offset_sigma, 0.05)
    middle = camera.offset_s or 0.0
    return ClockPrior(
        offset_s=middle,
        offset_sigma_s=offset_sigma,
        clock_scale_sigma=sigma.frame_rate if free else 1e-7,
        allowed=ClockRange(low_s=middle - width, high_s=middle + width, clock_scale=clock_scale),
    )


def _extended(
    seen: Mapping[str, View],
    priors: Mapping[str, ClockPrior | None],
    beam: Sequence[Hypothesis],
    name: str,
    cost: _Cost,
) -> list[Hypothesis]:
    """Every hypothesis with camera `name` added in every promising way, best first; none where the cost is given up."""
    prior = priors[name]
    assert prior is not None
    grown: list[Hypothesis] = []
    for fit in beam:
        placed = [SetCamera(view=seen[c], offset_s=o, clock_scale=s) for c, (o, s) in fit.clock.items()]
        for guess in cost.sweep(seen[name], placed, prior.allowed, GUESSES):
            clocks = {**fit.clock, name: (guess.offset_s, guess.clock_scale)}
            grown.append(_polished(clocks, seen, priors, cost, effort=ROUGH))
    grown = [fit for fit in grown if _within(fit, name, prior.allowed, seen[name]) and fit.overlap >= cost.overlap]
    if not grown and cost.overlap > 0:
        return []
    if not grown:
        raise _no_overlap(name, list(beam[0].clock), prior.allowed)
    if min(fit.misfit for fit in grown) > cost.hopeless:
        return []
    promising = _distinct(grown, seen)[:BEAM]
    polished = sorted((_polished(fit.clock, seen, priors, cost) for fit in promising), key=lambda f: f.cost)
    probes = _valley(polished[0], name, prior.allowed, seen)
    whole = [*polished, *(_polished(clock, seen, priors, cost) for clock in probes)]
    return _distinct([fit for fit in whole if fit.overlap >= cost.overlap], seen)


def _valley(
    best: Hypothesis, name: str, allowed: ClockRange, seen: Mapping[str, View]
) -> list[Mapping[str, tuple[float, float]]]:
    """Other starts in a long flat valley: where an offset is weak, its trade with the frame rate may have two ends."""
    sigma = best.sigma_s.get(name, 0.0)
    if sigma < WEAK_S:
        return []
    middle = 0.5 * sum(seen[name].span_s)
    starts: list[Mapping[str, tuple[float, float]]] = []
    for clock_scale in (1 - 0.6 * allowed.clock_scale, 1 + 0.6 * allowed.clock_scale):
        for away in (-6 * sigma, 6 * sigma):
            starts.append({**best.clock, name: (_middle(best, name, seen) + away - clock_scale * middle, clock_scale)})
    return starts


def _polished(
    clocks: Mapping[str, tuple[float, float]],
    seen: Mapping[str, View],
    priors: Mapping[str, ClockPrior | None],
    cost: _Cost,
    effort: float = 1.0,
) -> Hypothesis:
    return cost.polish([seen[c] for c in clocks], list(clocks.values()), [priors[c] for c in clocks], effort)


def _within(fit: Hypothesis, name: str, allowed: ClockRange, view: View) -> bool:
    """Whether polishing left the clock where it may be, give or take a tenth."""
    offset, clock_scale = fit.clock[name]
    slack = 0.1 * (allowed.high_s - allowed.low_s) / 2 + 0.1 * allowed.clock_scale * max(abs(t) for t in view.span_s)
    in_time = allowed.low_s - slack <= offset <= allowed.high_s + slack
    return in_time and abs(clock_scale - 1) <= 1.2 * allowed.clock_scale + 1e-6 and fit.overlap > 0


def _distinct(fits: Sequence[Hypothesis], seen: Mapping[str, View]) -> list[Hypothesis]:
    """Best first, without those that say the same as a better one."""
    kept: list[Hypothesis] = []
    for fit in sorted(fits, key=lambda f: f.cost):
        if all(_apart(fit, other, seen) for other in kept):
            kept.append(fit)
    return kept


def _apart(one: Hypothesis, other: Hypothesis, seen: Mapping[str, View]) -> bool:
    """Whether two hypotheses differ in the common time of some camera's mid-track."""
    return any(abs(_middle(one, name, seen) - _middle(other, name, seen)) > SAME_S for name in one.clock)


def _worth_carrying(beam: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses that further cameras could still make the best."""
    margin = max(30.0, 0.5 * beam[0].cost)
    return [fit for fit in beam if fit.cost <= beam[0].cost + margin][:BEAM]


def _alternatives(
    best: Hypothesis,
    others: Sequence[tuple[str, Hypothesis]],
    seen: Mapping[str, View],
    priors: Mapping[str, ClockPrior | None],
    cost: _Cost,
) -> list[Hypothesis]:
    """Whole hypotheses that differ from the best in one camera's clock: another answer that its own search gave."""
    found = [fit for _, fit in others if len(fit.clock) == len(best.clock)]
    for camera, fit in others:
        if len(fit.clock) < len(best.clock) and abs(_middle(fit, camera, seen) - _middle(best, camera, seen)) > SAME_S:
            found.append(_polished({**best.clock, camera: fit.clock[camera]}, seen, priors, cost))
    return found


def _middle(fit: Hypothesis, camera: str, seen: Mapping[str, View]) -> float:
    """Common time of the middle of a camera's sightings."""
    offset, clock_scale = fit.clock[camera]
    return offset + clock_scale * 0.5 * sum(seen[camera].span_s)


def _candidate(fit: Hypothesis, rates: Mapping[str, float], problem: Problem) -> OffsetCandidate:
    reference = problem.reference_camera
    names = [c.camera for c in problem.cameras if c.camera != reference]
    return OffsetCandidate(
        offset_s={reference: 0.0, **{n: fit.clock[n][0] for n in names}},
        frame_rate={reference: rates[reference], **{n: rates[n] / fit.clock[n][1] for n in names}},
        cost=float(fit.cost),
    )


def is_ambiguous(candidates: Sequence[OffsetCandidate]) -> bool:
    """Whether the next candidate is nearly as good as the best: less than a likelihood ratio of 100 apart."""
    return len(candidates) > 1 and candidates[1].cost - candidates[0].cost < CLEAR
