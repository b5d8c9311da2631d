"""Levenberg-Marquardt: linearise, damp, step, and see whether the cost agrees.

The damping is relative to the diagonal and follows Nielsen: divided by up to three where the quadratic model
foretold the cost well, doubled and redoubled where it did not.

Residuals that bend add to the curvature what J'J does not know. Where the last step showed more of it, the next one is
shortened by as much (Barzilai and Borwein, IMA J. Numer. Anal. 8, 1988, in the metric of J'J): with splines the cost's
curvature is up to twice the foretold one, and full steps swing to and fro.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.records import SolveStatus
from pipeline.solver.adjustment import compiled_descent
from pipeline.solver.adjustment.assembly import Linear, linear, linear_again, moved
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.compiled_descent import is_dense
from pipeline.solver.adjustment.log_poses import Renew
from pipeline.solver.adjustment.model import Model, State

SMALL = 1e-9
"""Relative change of the cost that ends the iteration. Twice as much ends it a step earlier at most; 1e-9 of a cost of
1e4 is a thousandth of a sigma."""
FIRST_DAMPING, NEARLY_FULL = 1e-7, 1e-4
"""Relative. Every iteration keeps a share of the error that grows with damping and condition (1e-4 costs some two more
iterations); a step damped by no more than `NEARLY_FULL` is as good as the full one when it says that nothing is to
gain."""
SMALLEST_DAMPING, GREATEST_DAMPING = 1e-15, 1e12
"""Relative: rounding of the matrix itself; where steps have become so short that there is no way on."""
BENT, SHORTEST = 1.25, 0.4
"""How many times the foretold curvature a step has to meet for the next to be shortened, and the shortest share of a
step. Neither moves the optimum; doubling either makes splines swing again."""
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
    renew: Renew | None = None


class Point(Protocol):
    """An adjustment linearised at a point, whose frames' own errors follow every step in closed form."""

    @property
    def cost(self) -> float:
        """Half the robust chi-square, priors included."""
        ...

    @property
    def frame_gain(self) -> float:
        """What moving the frames' own errors alone would take off the cost."""
        ...

    def step(self, damping: float) -> tuple[Floats, float] | None:
        """The step (n + q,) at a relative damping and what it is foretold to take off the cost; None: not positive."""
        ...

    def tried(self, step: Floats, renew: Renew | None) -> Point:
        """The adjustment linearised a step away, with its data renewed there."""
        ...

    def linear(self) -> Linear:
        """The normal equations there."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class AnyPoint:
    """A `Point` of any model, from its banded normal equations."""

    here: Linear

    @property
    def cost(self) -> float:
        """See `Point`."""
        return self.here.cost

    @property
    def frame_gain(self) -> float:
        """See `Point`."""
        return self.here.frame_gain

    def step(self, damping: float) -> tuple[Floats, float] | None:
        """See `Point`."""
        system = self.here.system
        diagonal = np.maximum(system.diagonal, 1e-12 * max(1e-300, float(system.diagonal.max(initial=0))))
        factor = factorise(system.damped(damping * diagonal))
        if factor is None:
            return None
        step = -factor.solve(system.gradient)
        return step, 0.5 * float(step @ (damping * diagonal * step - system.gradient)) + self.here.frame_gain

    def tried(self, step: Floats, renew: Renew | None) -> AnyPoint:
        """See `Point`."""
        model, state = self.here.model, moved(self.here.model, self.here, step)
        return AnyPoint(here=linear(model if renew is None else renew(model, state), state))

    def linear(self) -> Linear:
        """See `Point`."""
        return self.here


def levenberg_marquardt(
    model: Model, start: State, descent: Descent = Descent(), *, small: float = SMALL, begun: Linear | None = None
) -> Fit:
    """Minimise from `start`, until a step takes less than the share `small` off the cost.

    `begun` is a linearisation at `start`, perhaps under other priors: it is taken where it holds.
    """
    if descent.renew is not None:
        model = descent.renew(model, start)
    if is_dense(model):
        return _descended(compiled_descent.linearised(model, start), descent, small)
    return _descended(AnyPoint(here=linear_again(model, start, begun)), descent, small)


def levenberg_marquardt_plain(model: Model, start: State, descent: Descent = Descent(), *, small: float = SMALL) -> Fit:
    """The same by the normal equations that every model has."""
    if descent.renew is not None:
        model = descent.renew(model, start)
    return _descended(AnyPoint(here=linear(model, start)), descent, small)


def _descended(here: Point, descent: Descent, small: float) -> Fit:
    """The iteration itself."""
    damping, growth, share = descent.damping, 2.0, 1.0
    for iteration in range(1, descent.max_iterations + 1):
        found = here.step(damping)
        if found is not None:
            step, foretold = found
            if foretold <= small * here.cost and damping <= NEARLY_FULL:
                return _fit(here, "converged", iteration)
            there = here.tried(share * step, descent.renew)
            shared = foretold - here.frame_gain
            foretold = here.frame_gain + share * (2 - share) * shared
            if descent.progress is not None:
                descent.progress(iteration, min(here.cost, there.cost))
            ratio = (here.cost - there.cost) / max(foretold, 1e-300)
            if np.isfinite(there.cost) and ratio > 0:
                share = _share(share, here.cost - there.cost - here.frame_gain, shared)
                done = abs(here.cost - there.cost) <= small * here.cost
                here = there
                if done:
                    return _fit(here, "converged", iteration)
                damping, growth = max(damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3), SMALLEST_DAMPING), 2.0
                continue
            if foretold <= small * here.cost:
                return _fit(here, "converged", iteration)
            share = 1.0
        damping, growth = damping * growth, growth * 2
        if damping > GREATEST_DAMPING:
            return _fit(here, "stalled", iteration)
    return _fit(here, "iteration-limit", descent.max_iterations)


def _share(share: float, taken: float, foretold: float) -> float:
    """The share of the next step, from what this one took off the cost and what the whole was foretold to."""
    if not foretold > 0:
        return 1.0
    curvature = (2 * share * foretold - taken) / (share**2 * foretold)
    return max(SHORTEST, 1 / curvature) if curvature > BENT else 1.0


def _fit(here: Point, status: SolveStatus, iterations: int) -> Fit:
    found = here.linear()
    return Fit(model=found.model, linear=found, status=status, iterations=iterations)
