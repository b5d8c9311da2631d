"""Stage 4: sight rays, measured poses and clocks' first guesses become motions, clocks and corrected poses.

Six methods over one residual, one clock and one motion basis:

    triangulation   points of synchronised frames (paper eq. 6), and a motion through them
    intersection    the motion at given times (paper eq. 8)
    li              intersection and offsets in turn (paper section 2.3)
    algorithm-1     motion, offsets and frame rates together (paper eq. 9 to 11)
    algorithm-2     the same with a free rotation for every frame (paper eq. 14, 15)
    map             the statistical form of all of it (this project's own)
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from pipeline.records import OffsetCandidate, Problem, Solution, SolverSettings
from pipeline.solver import li
from pipeline.solver import map as statistical
from pipeline.solver.assembly import linear
from pipeline.solver.bordered import factorise
from pipeline.solver.covariance import Inverse
from pipeline.solver.findings import find_degeneracies
from pipeline.solver.intersection import intersect
from pipeline.solver.layout import Frames, metric, pack
from pipeline.solver.levenberg import Fit, Progress, levenberg_marquardt
from pipeline.solver.results import Outcome, solution_of
from pipeline.solver.start import first_camera, first_choice, first_model, given_offsets
from pipeline.solver.triangulation import triangulate

LI_ROUNDS = 500
Finish = Callable[[], Outcome]
"""What is left to do after the optimum is found: covariances."""


def solve(problem: Problem, settings: SolverSettings, *, progress: Progress | None = None) -> Solution:
    """Adjust `problem` by `settings.method`.

    `progress` is called with (iteration, cost). `Solution.seconds` counts the numerical solve alone: from packed
    arrays to the optimum, without the search of offsets, the covariances and the making of the record.

    Raises GeometryError where the sightings cannot determine the answer; what a prior decides is a finding. Not
    converging is a status, not an error.
    """
    find_degeneracies(problem, settings)
    frames = pack(problem)
    method = METHODS[settings.method]
    began = time.perf_counter()
    found = method(problem, settings, frames, progress)
    seconds = time.perf_counter() - began
    solution = solution_of(problem, settings, found(), seconds)
    orders = {m.target: m.degree for m in solution.motions if m.kind == "polynomial"}
    left_open = find_degeneracies(problem, settings, clocks=solution.clocks, orders=orders)
    return replace(solution, findings=(*solution.findings, *left_open))


def _intersection(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None) -> Finish:
    camera = first_camera(problem, given_offsets(problem), {})
    model, state = first_model(problem, settings, metric(frames), first_choice(problem), camera)
    here = linear(model, intersect(model, state))
    return partial(_paper_outcome, frames, Fit(model=model, linear=here, status="converged", iterations=1))


def _li(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None) -> Finish:
    camera = first_camera(problem, given_offsets(problem), {})
    model, state = first_model(problem, settings, metric(frames), first_choice(problem), camera)
    return partial(_paper_outcome, frames, li.alternate(model, state, LI_ROUNDS, progress))


def _algorithm(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None) -> Finish:
    found = statistical.candidates(problem, settings)
    camera = first_camera(problem, found[0].offset_s, found[0].frame_rate)
    model, state = first_model(problem, settings, metric(frames), first_choice(problem), camera)
    fit = levenberg_marquardt(model, intersect(model, state), max_iterations=settings.max_iterations, progress=progress)
    return partial(_paper_outcome, frames, fit, found)


def _paper_outcome(frames: Frames, fit: Fit, candidates: tuple[OffsetCandidate, ...] = ()) -> Outcome:
    """With the covariance that the residuals themselves suggest: the paper's metres have no sigma."""
    free = fit.model.order.n_band + fit.model.order.n_border + 3 * fit.model.frames.count * fit.model.pose.free
    redundancy = 2 * int(frames.seen.sum()) - free
    factor = factorise(fit.linear.system)
    known = factor is not None and redundancy > 0
    return Outcome(
        model=fit.model, observed=frames, state=fit.state, status=fit.status, iterations=fit.iterations, cost=fit.cost,
        plain=Inverse(factor=factor, scale=2 * fit.cost / redundancy) if known and factor is not None else None,
        candidates=candidates,
    )  # fmt: skip


def _triangulation(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None) -> Finish:
    found = triangulate(problem, settings, frames)
    return lambda: found


def _map(problem: Problem, settings: SolverSettings, frames: Frames, progress: Progress | None) -> Finish:
    return partial(statistical.outcome, frames, statistical.adjust(problem, settings, frames, progress))


METHODS: dict[str, Callable[[Problem, SolverSettings, Frames, Progress | None], Finish]] = {
    "triangulation": _triangulation,
    "intersection": _intersection,
    "li": _li,
    "algorithm-1": _algorithm,
    "algorithm-2": _algorithm,
    "map": _map,
}
