"""Li's iteration with a stated number of rounds.

The paper: "typically requires 4-8 iterations". Run on until nothing moves, the alternation reaches the minimum of the
same cost as Algorithm 1 with frame rates held, however long that takes; what the paper compares with is the iteration
as it is used. A round is one intersection and one descent in every camera's offset.
"""

from __future__ import annotations

import time
from dataclasses import replace

from pipeline.experiments.flying.li_plain import iterated, sights_of
from pipeline.records import Problem, Solution, SolverSettings
from pipeline.solver.adjustment import compiled_descent
from pipeline.solver.adjustment.assembly import linear
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import Model, State
from pipeline.solver.methods.intersection import intersect
from pipeline.solver.methods.li import alternate
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model, given_offsets
from pipeline.solver.methods.results import Outcome, solution_of
from pipeline.solver.observation.clocks import OFFSET
from pipeline.solver.observation.observations import Frames, metric, pack


def solve_li(problem: Problem, settings: SolverSettings, *, plain: bool = False) -> Solution:
    """Li with at most `settings.max_iterations` rounds. Raises GeometryError where the rays do not determine it.

    `plain`: the rounds by `li_plain`; only the record is then made by the solver, at the offsets found.
    """
    found, seconds = alternated(problem, settings, pack(problem), plain=plain)
    return solution_of(problem, settings, found, seconds)


def alternated(
    problem: Problem, settings: SolverSettings, frames: Frames, *, plain: bool = False
) -> tuple[Outcome, float]:
    """The same on packed sightings, without the record: where it ends, and the seconds it took."""
    if plain:
        return _plainly(problem, settings, frames)
    compiled_descent.warm()
    began = time.perf_counter()
    model, state = _begun(problem, settings, frames)
    fit = alternate(model, state, settings.max_iterations)
    return _outcome(fit, frames), time.perf_counter() - began


def _plainly(problem: Problem, settings: SolverSettings, frames: Frames) -> tuple[Outcome, float]:
    """The same by NumPy and SciPy."""
    model, state = _begun(problem, settings, frames)
    offsets = state.camera[:, OFFSET].copy()
    began = time.perf_counter()
    sights = sights_of(frames, list(first_choice(problem, "li").orders))
    offset_s, rounds, rests = iterated(sights, offsets, settings.max_iterations)
    seconds = time.perf_counter() - began
    camera = state.camera.copy()
    camera[:, OFFSET] = offset_s
    state = intersect(model, replace(state, camera=camera))
    fit = Fit(
        model=model, linear=linear(model, state), status="converged" if rests else "iteration-limit", iterations=rounds
    )
    return _outcome(fit, frames), seconds


def _begun(problem: Problem, settings: SolverSettings, frames: Frames) -> tuple[Model, State]:
    camera = first_camera(problem, given_offsets(problem), {})
    return first_model(problem, settings, metric(frames), first_choice(problem, "li"), camera)


def _outcome(fit: Fit, frames: Frames) -> Outcome:
    return Outcome(
        model=fit.model, observed=frames, state=fit.state, status=fit.status, iterations=fit.iterations, cost=fit.cost,
        plain=None,
    )  # fmt: skip
