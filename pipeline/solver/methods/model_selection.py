"""Order "auto": the lowest order of a polynomial that the data do not clearly outvote.

One order more is three unknowns more. They must take more off twice the cost than log(2 m) each, m the target's
sightings (the Bayesian information criterion). From order 1 the order is raised one by one, all targets in turn, each
time from the motion found so far; a target whose speed is worth no unknowns falls to order 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.records import Finding, Problem
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.parameters import MotionChoice, basis_at, with_basis
from pipeline.solver.observation.clocks import common_time_s

HIGHEST = 5
Descend = Callable[[Model, State], Fit]


def choose_orders(
    problem: Problem, choice: MotionChoice, fit: Fit, descend: Descend
) -> tuple[MotionChoice, Fit, tuple[Finding, ...]]:
    """The orders in force, the adjustment with them, and the reason of each choice."""
    findings = []
    for n, target in enumerate(problem.targets):
        if target.motion != "polynomial" or target.order != "auto":
            continue
        price = penalty(fit.model, n)
        gained = 0.0
        while choice.orders[n] < HIGHEST:
            higher = _with_order(choice, n, choice.orders[n] + 1)
            trial = _tried(fit, higher, descend)
            gained = 2 * (fit.cost - trial.cost)
            if gained <= price:
                break
            choice, fit = higher, trial
        if choice.orders[n] == 1:
            lower = _with_order(choice, n, 0)
            trial = _tried(fit, lower, descend)
            if 2 * (trial.cost - fit.cost) < price:
                choice, fit = lower, trial
        findings.append(_reason(target.target, choice.orders[n], gained, price))
    return choice, fit, tuple(findings)


def penalty(model: Model, target: int) -> float:
    """What three more unknowns must take off twice the cost."""
    frames = model.frames
    sightings = float(frames.seen[:, target].sum())
    return 3 * float(np.log(max(2 * sightings, 2.0)))


def _with_order(choice: MotionChoice, target: int, order: int) -> MotionChoice:
    orders = tuple(order if n == target else k for n, k in enumerate(choice.orders))
    return replace(choice, orders=orders)


def _tried(fit: Fit, choice: MotionChoice, descend: Descend) -> Fit:
    time = common_time_s(fit.model.frames, fit.model.drift, fit.state.camera, fit.state.deviation)
    model, state = with_basis(fit.model, fit.state, basis_at(fit.model.frames, choice, time))
    found = descend(model, state)
    return replace(found, iterations=fit.iterations + found.iterations)


def _reason(target: str, order: int, gained: float, price: float) -> Finding:
    words = f"{target} is given a motion of order {order}: "
    if order == HIGHEST:
        words += f"the highest there is; each order up to it was worth its price of {price:.1f}"
    else:
        words += f"order {order + 1} would take {gained:.1f} off chi-square, less than its price of {price:.1f}"
    return Finding(kind="motion-order", subject=target, words=words)
