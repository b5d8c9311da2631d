"""Levenberg-Marquardt: linearise, damp, step, and see whether the cost agrees.

The damping is relative to the diagonal and follows Nielsen: divided by up to three where the quadratic model
foretold the cost well, doubled and redoubled where it did not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.records import SolveStatus
from pipeline.solver.adjustment import compiled_descent
from pipeline.solver.adjustment._descent import FIRST_DAMPING, NEARLY_FULL
from pipeline.solver.adjustment.assembly import Linear, linear, moved
from pipeline.solver.adjustment.banded_system import Bordered, factorise
from pipeline.solver.adjustment.compiled_descent import is_dense
from pipeline.solver.adjustment.model import Model, State

SMALL = 1e-9
"""Relative change of the cost that ends the iteration."""
Progress = Callable[[int, float], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Where the iteration ended, linearised there, and how. `model` holds the data as they were there."""

    model: Model
    linear: Linear
    status: SolveStatus
    iterations: int

    @property
    def state(self) -> State:
        """The point."""
        return self.linear.state

    @property
    def cost(self) -> float:
        """Half the robust chi-square, priors included."""
        return self.linear.cost


@dataclass(frozen=True, kw_only=True)
class Descent:
    """How to go downhill: at most so many iterations, whom to tell, and what renews the model's data after a step.

    damping  to begin with; small where the start is near the optimum, since it only fades by a third a step
    """

    max_iterations: int = 100
    damping: float = FIRST_DAMPING
    progress: Progress | None = None
    renew: Callable[[Model, State], Model] | None = None


def levenberg_marquardt(model: Model, start: State, descent: Descent = Descent(), *, small: float = SMALL) -> Fit:
    """Minimise from `start`, until a step takes less than the share `small` off the cost."""
    if descent.renew is None and is_dense(model):
        return _compiled(model, start, descent, small)
    return levenberg_marquardt_plain(model, start, descent, small=small)


def _compiled(model: Model, start: State, descent: Descent, small: float) -> Fit:
    """The same path in one compiled call."""
    return ended(model, descent, compiled_descent.descend(model, start, descent.max_iterations, small, descent.damping))


def ended(model: Model, descent: Descent, found: tuple[Any, ...]) -> Fit:
    """The fit that a compiled descent found."""
    status, iterations, state, corner, gradient, cost, gain, history = found
    if descent.progress is not None:
        for count, reached in enumerate(history, start=1):
            descent.progress(count, float(reached))
    empty = np.empty((1, 0)), np.empty((0, len(gradient)))
    system = Bordered(band=empty[0], border=empty[1], corner=corner, gradient=gradient)
    here = Linear(model=model, state=state, system=system, cost=cost, frame_gain=gain)
    return Fit(model=model, linear=here, status=status, iterations=iterations)


def levenberg_marquardt_plain(model: Model, start: State, descent: Descent = Descent(), *, small: float = SMALL) -> Fit:
    """The loop itself, for every model; see `levenberg_marquardt`."""
    renew, progress, max_iterations = descent.renew, descent.progress, descent.max_iterations
    if renew is not None:
        model = renew(model, start)
    here = linear(model, start)
    damping, growth = descent.damping, 2.0
    for iteration in range(1, max_iterations + 1):
        diagonal = np.maximum(here.system.diagonal, 1e-12 * max(1e-300, float(here.system.diagonal.max(initial=0))))
        factor = factorise(here.system.damped(damping * diagonal))
        gain = -np.inf
        if factor is not None:
            step = -factor.solve(here.system.gradient)
            foretold = 0.5 * float(step @ (damping * diagonal * step - here.system.gradient)) + here.frame_gain
            if foretold <= small * here.cost and damping <= NEARLY_FULL:
                return Fit(model=model, linear=here, status="converged", iterations=iteration)
            trial_model, trial = model, moved(model, here, step)
            if renew is not None:
                trial_model = renew(model, trial)
            there = linear(trial_model, trial)
            gain = (here.cost - there.cost) / max(foretold, 1e-300)
            if progress is not None:
                progress(iteration, min(here.cost, there.cost))
            if not np.isfinite(there.cost):
                gain = -np.inf
            if gain > 0:
                done = abs(here.cost - there.cost) <= small * here.cost
                model, here = trial_model, there
                if done:
                    return Fit(model=model, linear=here, status="converged", iterations=iteration)
                damping, growth = max(damping * max(1 / 3, 1 - (2 * gain - 1) ** 3), 1e-15), 2.0
                continue
            if foretold <= small * here.cost:
                return Fit(model=model, linear=here, status="converged", iterations=iteration)
        damping, growth = damping * growth, growth * 2
        if damping > 1e12:
            return Fit(model=model, linear=here, status="stalled", iterations=iteration)
    return Fit(model=model, linear=here, status="iteration-limit", iterations=max_iterations)
