"""How every target moves, said by the data: a polynomial of some order, or a spline. All targets are judged together.

Every target whose motion the data shall say begins as a spline, which comes home whatever it does. From there:

    screen     a target stays a spline where its path has parts beyond a polynomial of `HIGHEST`: projections c of the
               spline on Legendre polynomials of higher degree, c' C^-1 c is chi-square
    raise      all others become polynomials of order `TRIED`, at once
    lower      the order whose loss the data mind least, of all targets, goes first: with a the coefficients that are
               dropped and S their covariance in the adjustment of all, dropping them costs a' S^-1 a, chi-square with
               three degrees an order, all dropped before among them. It stops where the data mind
    hold       the polynomials are adjusted and must fit as well as the splines did, by as many degrees as they save

No step depends on the order in which targets are named. The tests reject at `CHANCE`, not by the information criterion:
that would take a motion that is too simple by three sigmas, and a claim three sigmas too small with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, chdtri

from calibration.foundation.arrays import Floats
from pipeline.records import Finding, Problem
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.goodness_of_fit import data_cost, redundancy_left
from pipeline.solver.methods.initialisation import differ, residual_lengths
from pipeline.solver.methods.lone_stretches import Lone
from pipeline.solver.methods.parameters import MotionChoice, basis_at, with_basis
from pipeline.solver.observation.clocks import common_time_s

HIGHEST, TRIED, PROJECTED = 5, (7, 5, 3), 16
"""Highest order taken; orders from which orders are lowered, the next where few sightings leave the one before
undetermined; Legendre degree to which a spline's path is looked at."""
CHANCE, SCREENED = 0.01, 1e-4
"""Chance at which a true order would be rejected, and a target be left a spline without trying."""
MOST_LONE, DEAR = 2, 40.0
"""Highest order of a target that one camera alone sees: more it cannot tell from its own flight; and what an order must
take off chi-square, since along its rays such a target moves for nothing."""
MOST_SURE = 1
"""Highest order that was found and is still believed where one camera alone sees the target. A polynomial of higher
order is a likeness of what two saw; beyond that it goes its own way: 250 m off in 5 s, at 22 m claimed."""
Descend = Callable[[Model, State], Fit]


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Motions in force, the adjustment with them, the reason of each choice."""

    choice: MotionChoice
    fit: Fit
    findings: tuple[Finding, ...]


def choose_motions(
    problem: Problem, choice: MotionChoice, fit: Fit, descend: Descend, simple: Callable[[], Fit], alone: Lone
) -> Chosen:
    """From an adjustment with splines for all targets whose motion the data shall say.

    `simple` is another one, with parabolas: where little tells the time, splines may have lost their way. `alone` is
    what one camera alone sees, which splines do without.
    """
    asked = [n for n, t in enumerate(problem.targets) if t.is_asked]
    if not asked:
        return Chosen(choice=choice, fit=fit, findings=())
    lone = [n for n in asked if choice.kinds[n] == "polynomial"]
    choice, fit = _raised(choice, fit, lone, descend, alone)
    free = [n for n in asked if n not in lone]
    beyond = _beyond(fit, free)
    tried = [n for n in free if beyond[n] > SCREENED]
    found = choice, fit
    starts = _starts(fit, simple) if tried else []
    while tried:
        lowered = _lowered(choice, starts, tried, descend, alone)
        rich = [n for n in tried if lowered is None or lowered.orders[n] > HIGHEST]
        if lowered is not None and not rich:
            held = _held(choice, fit, lowered, descend, alone)
            if not isinstance(held, dict):
                found = held
                break
            beyond = {**beyond, **held}
            rich = [min(tried, key=lambda n: (beyond[n], problem.targets[n].target))]
        tried = [n for n in tried if n not in rich]
    choice, fit = found
    return Chosen(choice=choice, fit=fit, findings=tuple(_reason(problem, choice, n) for n in (*lone, *free)))


def _raised(
    choice: MotionChoice, fit: Fit, lone: Sequence[int], descend: Descend, alone: Lone
) -> tuple[MotionChoice, Fit]:
    """Targets that one camera alone sees: still, unless the data mind; the one that minds most is raised first."""
    while True:
        trials = []
        for n in lone:
            if choice.orders[n] < MOST_LONE:
                wanted = {n: choice.orders[n] + 1}
                trials.append((with_orders(choice, wanted), adjusted(choice, fit, wanted, descend, alone)))
        best = min(trials, key=lambda trial: trial[1].cost, default=None)
        if best is None or 2 * (fit.cost - best[1].cost) / unit(fit) < DEAR:
            return choice, fit
        choice, fit = best


def _starts(fit: Fit, simple: Callable[[], Fit]) -> list[Fit]:
    """Adjustments to go on from: the one with splines, and the simple one where its clocks are others.

    At the same clocks both lead to one optimum, since motions enter nearly linearly.
    """
    other = simple()
    return [fit, _alike(other, fit)] if differ(other, fit) else [fit]


def _alike(start: Fit, fit: Fit) -> Fit:
    """Another start in the model of `fit`: its clocks' drifts and its poses' errors."""
    model = start.model.changed(pose=fit.model.pose, drift=fit.model.drift, wander=fit.model.wander)
    model = replace(model, loss=fit.model.loss)
    model = model.changed(priors=replace(model.priors, drift_rate=fit.model.priors.drift_rate))
    state = replace(
        start.state, deviation=fit.state.deviation, wander=fit.state.wander, own=np.zeros(start.state.own.shape)
    )
    return replace(start, model=model, linear=replace(start.linear, model=model, state=state))


@dataclass(frozen=True, kw_only=True)
class _Lowered:
    """Orders by target, and the adjustment from which they were lowered."""

    orders: dict[int, int]
    raised: Fit


def _beyond(fit: Fit, targets: Sequence[int]) -> dict[int, float]:
    """Of every target, the chance that its spline's path beyond a polynomial of `HIGHEST` is noise."""
    factor = factorise(fit.linear.system)
    out = dict.fromkeys(targets, 1.0)
    if factor is None:
        return out
    for n in targets:
        t, order = fit.model.basis.targets[n], fit.model.order
        degrees = min(PROJECTED, t.count - 1)
        if degrees <= HIGHEST:
            continue
        weight = _legendre_rows(fit, n, degrees)[HIGHEST + 1 :]
        value = weight @ fit.state.coefficients[t.first : t.first + t.count]
        columns = np.zeros((order.n_band + order.n_border, 3 * len(weight)))
        for axis in range(3):
            columns[
                order.coefficient[t.first : t.first + t.count, axis],
                axis * len(weight) + np.arange(len(weight))[:, None],
            ] = weight
        covariance = columns.T @ factor.solve(columns)
        flat = value.T.ravel()
        square = float(flat @ np.linalg.lstsq(covariance, flat, rcond=1e-12)[0])
        out[n] = float(chdtrc(len(flat), square / unit(fit)))
    return out


def _legendre_rows(fit: Fit, target: int, degrees: int) -> Floats:
    """(degrees + 1, count): projections of a spline on Legendre polynomials over its knots, by its coefficients."""
    basis, t = fit.model.basis, fit.model.basis.targets[target]
    nodes, weights = np.polynomial.legendre.leggauss(max(4 * t.count, 2 * degrees + 2))
    low, high = t.knots_s[0], t.knots_s[-1]
    time = 0.5 * (low + high) + 0.5 * (high - low) * nodes
    span = basis.span(time)
    u = (time - basis.mid_s[span]) / basis.half_s[span]
    value = np.einsum("bij,bi->bj", t.transform[span], u[:, None] ** np.arange(basis.degree + 1))
    whole = np.zeros((len(time), t.count))
    whole[np.arange(len(time))[:, None], t.active[span][:, None] - t.first + np.arange(t.degree + 1)] = value
    return np.asarray((np.polynomial.legendre.legvander(nodes, degrees) * weights[:, None]).T @ whole)


def unit(fit: Fit) -> float:
    """Chi-square per equation where that is above one: sigmas that claim too little say too much."""
    equations = 2 * float(fit.model.frames.seen.sum())
    return max(1.0, 2 * data_cost(fit) / equations)


def _lowered(
    choice: MotionChoice, starts: Sequence[Fit], tried: Sequence[int], descend: Descend, alone: Lone
) -> _Lowered | None:
    """Orders of the targets `tried`, lowered as far as the data let them from the first `TRIED` that they determine."""
    for most in TRIED:
        orders = {n: min(_highest(starts[0], n), most) for n in tried}
        raised = min((adjusted(choice, start, orders, descend, alone) for start in starts), key=lambda fit: fit.cost)
        factor = factorise(raised.linear.system)
        if factor is not None and raised.status != "stalled":
            break
    else:
        return None
    model, covariance = raised.model, factor.corner_covariance() * unit(raised)
    begin = dict(orders)

    def places(n: int, order: int) -> Floats:
        t = model.basis.targets[n]
        return np.asarray(model.order.coefficient[t.first + order, :] - model.order.n_band)

    values = {n: raised.state.coefficients[model.basis.targets[n].first :][: begin[n] + 1] for n in tried}

    def costs(now: dict[int, int]) -> float:
        gone = [(n, k) for n in tried for k in range(now[n] + 1, begin[n] + 1)]
        if not gone:
            return 0.0
        place = np.concatenate([places(n, k) for n, k in gone])
        value = np.concatenate([values[n][k] for n, k in gone])
        return float(value @ np.linalg.lstsq(covariance[np.ix_(place, place)], value, rcond=1e-13)[0])

    spent = 0.0
    while True:
        lower = {n: costs({**orders, n: orders[n] - 1}) - spent for n in tried if orders[n] > 0}
        if not lower:
            break
        n = min(lower, key=lambda m: (lower[m], model.basis.targets[m].target))
        dropped = sum(begin[m] - orders[m] for m in tried) + 1
        if lower[n] > chdtri(3, CHANCE) or spent + lower[n] > chdtri(3 * dropped, CHANCE):
            break
        orders[n] -= 1
        spent += lower[n]
    return _Lowered(orders=orders, raised=raised)


def _highest(fit: Fit, target: int) -> int:
    """Order to begin with: less where a target is seen for a short while, or seldom."""
    basis, frames = fit.model.basis, fit.model.frames
    t = basis.targets[target]
    share = float(np.ptp(t.knots_s) / np.ptp(basis.grid_s))
    sightings = int(frames.seen[:, target].sum())
    allowed = TRIED[0] if share > 0.3 else HIGHEST if share > 0.1 else 2
    return max(0, min(allowed, (2 * sightings) // 6 - 1))


def adjusted(choice: MotionChoice, fit: Fit, orders: dict[int, int], descend: Descend, alone: Lone) -> Fit:
    """The adjustment with polynomials of these orders."""
    wanted = with_orders(choice, orders)
    unsure = [n for n, kind in enumerate(wanted.kinds) if kind == "spline" or orders.get(n, 0) > MOST_SURE]
    shown = alone.without(fit.model.frames, unsure)
    time = common_time_s(fit.model.frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    model, state = with_basis(fit.model.changed(frames=shown), fit.state, basis_at(shown, wanted, time))
    found = descend(model, state)
    return replace(found, iterations=fit.iterations + found.iterations)


def with_orders(choice: MotionChoice, orders: dict[int, int]) -> MotionChoice:
    """The choice with polynomials of these orders, by target."""
    kinds = tuple("polynomial" if n in orders else kind for n, kind in enumerate(choice.kinds))
    return replace(choice, kinds=kinds, orders=tuple(orders.get(n, k) for n, k in enumerate(choice.orders)))


def _held(
    choice: MotionChoice, splines: Fit, lowered: _Lowered, descend: Descend, alone: Lone
) -> tuple[MotionChoice, Fit] | dict[int, float]:
    """The polynomials adjusted, where they fit as well as the splines; else of each, the less the more it minds."""
    orders = {n: min(k, HIGHEST) for n, k in lowered.orders.items()}
    fit = adjusted(choice, lowered.raised, orders, descend, alone)
    if fit.status == "stalled":
        return {}
    saved = redundancy_left(fit) - redundancy_left(splines)
    worse = 2 * (data_cost(fit) - data_cost(splines)) / unit(splines)
    if worse <= chdtri(max(saved, 3.0), CHANCE):
        return with_orders(choice, orders), fit
    minded = _squares(fit) - _squares(splines)
    return {n: -float(minded[n]) for n in orders}


def _squares(fit: Fit) -> Floats:
    """(N,) of each target, squared residuals beyond two for every sighting."""
    seen, loss = fit.model.frames.seen, fit.model.loss
    beyond = loss.cost(residual_lengths(fit.model, fit.state) ** 2) - 2
    return np.asarray(np.bincount(np.nonzero(seen)[1], weights=beyond, minlength=seen.shape[1]), np.float64)


def _reason(problem: Problem, choice: MotionChoice, n: int) -> Finding:
    target, order = problem.targets[n].target, choice.orders[n]
    if choice.kinds[n] == "spline" and problem.targets[n].motion == "polynomial":
        words = (
            f"no polynomial up to order {HIGHEST} fits the sightings of {target}: it is given a free motion (a spline)"
        )
        return Finding(kind="motion-richer", subject=target, words=words, carried_by=f"targets.{target}.motion")
    if choice.kinds[n] == "spline":
        words = f"{target} is given a free motion (a spline): no polynomial up to order {HIGHEST} fits its sightings"
    else:
        shape = {0: "a still point", 1: "straight, at constant speed"}.get(order, f"a polynomial of order {order}")
        words = f"{target} is given a motion of order {order} ({shape}): less would not fit, and nothing asks for more"
    return Finding(kind="motion-order", subject=target, words=words)
