"""An approach's answer to one flight: by the whole call, or straight from the numerical solve.

Hundreds of thousands of flights are solved, and of each answer only one target's motion, the second camera's clock and
the positions at the viewpoints are looked at. So `straight` runs the solver's own method on the packed sightings and
takes these from the optimum; what `solve` adds for a user (what the geometry leaves open, the robust covariance, the
record of every pose and residual) is left out. Tests hold both ways equal. Where a refusal or the seconds of the whole
call are among the results, an experiment asks for `whole`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from pipeline.experiments.declare import Approach
from pipeline.experiments.flying.li_rounds import alternated, solve_li
from pipeline.records import Motion, Problem, Solution, SolveStatus
from pipeline.solver import solve
from pipeline.solver.adjustment import compiled_descent
from pipeline.solver.adjustment.banded_system import factorise
from pipeline.solver.adjustment.renewal import renewing
from pipeline.solver.methods import map_estimation
from pipeline.solver.methods.initialisation import candidates
from pipeline.solver.methods.results import Outcome
from pipeline.solver.observation.clocks import OFFSET, SCALE, common_time_s
from pipeline.solver.observation.motion_basis import motion_of
from pipeline.solver.observation.observations import Frames
from pipeline.solver.solve import METHODS, Asked
from pipeline.solver.uncertainty.covariance import Inverse, motion_band


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What is looked at of a solution.

    motion      of the measured target
    offset_s, offset_sigma_s, frame_rate  of the second camera; NaN where there is one camera, or no sigma is known
    camera, frame, position_m  (m,), (m,), (m, 3) number of the camera, frame and found position of every viewpoint
    seconds     of the numerical solve
    """

    status: SolveStatus
    iterations: int
    motion: Motion
    offset_s: float
    offset_sigma_s: float
    frame_rate: float
    camera: Ints
    frame: Ints
    position_m: Floats
    seconds: float


def whole(problem: Problem, approach: Approach, target: int) -> Answer:
    """The answer of the whole call. Raises GeometryError where the sightings do not determine one."""
    if approach.settings.method == "li":
        return answer_of(solve_li(problem, approach.settings, plain=approach.plain), problem, target)
    return answer_of(solve(problem, approach.settings), problem, target)


def answer_of(found: Solution, problem: Problem, target: int) -> Answer:
    """What is looked at of a user's solution."""
    seen, names = found.sightings, [c.camera for c in problem.cameras]
    own = np.array([t == problem.targets[target].target for t in seen.target], dtype=bool)
    clock = found.clocks[1] if len(found.clocks) > 1 else None
    return Answer(
        status=found.status, iterations=found.iterations, motion=found.motions[target], seconds=found.seconds,
        offset_s=np.nan if clock is None else clock.offset_s,
        offset_sigma_s=np.nan if clock is None else _plain_offset_sigma_s(found, clock.camera),
        frame_rate=np.nan if clock is None else clock.frame_rate,
        camera=np.array([names.index(c) for c in seen.camera], dtype=np.int64)[own], frame=seen.frame[own],
        position_m=seen.position_enu_m[own],
    )  # fmt: skip


def straight(problem: Problem, frames: Frames, approach: Approach, target: int) -> Answer:
    """The same from the optimum alone; `frames` are the problem's sightings, packed. Raises GeometryError."""
    found, seconds = optimum(problem, frames, approach)
    model, state, places = found.model, found.state, found.model.frames
    common_s = common_time_s(places, model.drift, state.camera, state.deviation)
    own = np.flatnonzero(places.seen[:, target])
    basis = model.basis.targets[target]
    motion = motion_of(
        basis, state.coefficients[basis.first : basis.first + basis.count],
        None if found.plain is None else motion_band(found.plain, model, target),
        float(common_s[own].min()), float(common_s[own].max()),
    )  # fmt: skip
    offset_s, offset_sigma_s, frame_rate = _second_clock(found)
    return Answer(
        status=found.status, iterations=found.iterations, motion=motion, seconds=seconds, offset_s=offset_s,
        offset_sigma_s=offset_sigma_s, frame_rate=frame_rate, camera=places.camera[own], frame=places.frame[own],
        position_m=model.basis.position(common_s, state.coefficients)[own, target],
    )  # fmt: skip


def optimum(problem: Problem, frames: Frames, approach: Approach) -> tuple[Outcome, float]:
    """Where the method ends, with its plain covariance, and the seconds that the solve took."""
    settings = approach.settings
    if settings.method == "li":
        return alternated(problem, settings, frames, plain=approach.plain)
    starts, renew = candidates(problem, settings), renewing(problem)
    compiled_descent.warm()
    began = time.perf_counter()
    if settings.method == "map":
        found = map_estimation.adjust(problem, settings, frames, starts, renew=renew)
        seconds = time.perf_counter() - began
        factor = factorise(found.fit.linear.system)
        return _without_robust(found, None if factor is None else Inverse(factor=factor)), seconds
    asked = Asked(problem=problem, settings=settings, frames=frames, starts=starts, progress=None, renew=renew)
    finish = METHODS[settings.method](asked)
    seconds = time.perf_counter() - began
    return finish(), seconds


def _without_robust(found: map_estimation.Adjusted, plain: Inverse | None) -> Outcome:
    fit = found.fit
    return Outcome(
        model=fit.model, observed=fit.model.frames, state=fit.state, status=fit.status, iterations=fit.iterations,
        cost=fit.cost, plain=plain,
    )  # fmt: skip


def _plain_offset_sigma_s(found: Solution, camera: str) -> float:
    """Of the plain covariance, which the bound is about; a `Clock` has the larger of plain and robust."""
    name = f"{camera}.offset_s"
    plain = found.shared_covariance
    if plain is None or name not in found.shared_names:
        return found.clock(camera).offset_sigma_s
    at = found.shared_names.index(name)
    return float(np.sqrt(max(plain[at, at], 0.0)))


def _second_clock(found: Outcome) -> tuple[float, float, float]:
    """Offset, its sigma and frame rate of the second camera."""
    model, state = found.model, found.state
    if len(model.frames.cameras) < 2:
        return np.nan, np.nan, np.nan
    place, sigma = model.order.camera[1, OFFSET], 0.0
    if place >= 0:
        variance = np.nan if found.plain is None else float(found.plain.pairs(np.array([place]), np.array([place]))[0])
        sigma = float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.nan
    rate = float(model.frames.nominal_rate[1] / (1 + state.camera[1, SCALE]))
    return float(state.camera[1, OFFSET]), sigma, rate
