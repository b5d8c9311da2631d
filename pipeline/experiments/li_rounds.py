"""Li's iteration with a stated number of rounds.

The paper: "typically requires 4-8 iterations". Run on until nothing moves, the alternation reaches the minimum of the
same cost as Algorithm 1 with frame rates held, however long that takes; what the paper compares with is the iteration
as it is used. A round is one intersection and one descent in every camera's offset.
"""

from __future__ import annotations

import time

from pipeline.records import Problem, Solution, SolverSettings
from pipeline.solver import dense
from pipeline.solver.layout import Frames, metric, pack
from pipeline.solver.li import alternate
from pipeline.solver.results import Outcome, solution_of
from pipeline.solver.start import first_camera, first_choice, first_model, given_offsets


def solve_li(problem: Problem, settings: SolverSettings) -> Solution:
    """Li with at most `settings.max_iterations` rounds. Raises GeometryError where the rays do not determine it."""
    found, seconds = alternated(problem, settings, pack(problem))
    return solution_of(problem, settings, found, seconds)


def alternated(problem: Problem, settings: SolverSettings, frames: Frames) -> tuple[Outcome, float]:
    """The same on packed sightings, without the record: where it ends, and the seconds it took."""
    dense.warm()
    began = time.perf_counter()
    camera = first_camera(problem, given_offsets(problem), {})
    model, state = first_model(problem, settings, metric(frames), first_choice(problem), camera)
    fit = alternate(model, state, settings.max_iterations)
    seconds = time.perf_counter() - began
    found = Outcome(
        model=fit.model, observed=frames, state=fit.state, status=fit.status, iterations=fit.iterations, cost=fit.cost,
        plain=None,
    )  # fmt: skip
    return found, seconds
