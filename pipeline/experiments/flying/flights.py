"""One run of one cell: a flight drawn from its own seed, and every approach's answer measured against the truth."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from calibration.foundation.errors import GeometryError
from pipeline.experiments.declare import Approach, Cell, Experiment, Spell
from pipeline.experiments.flying.answers import Answer, optimum, straight, whole
from pipeline.experiments.flying.measure import MEASURES, measure, place
from pipeline.records import CameraInput, Problem
from pipeline.solver.observability.findings import find_degeneracies
from pipeline.solver.observation.observations import Frames, pack
from pipeline.synthetic.scene import Scene
from pipeline.synthetic.simulate import simulate


def run_seed(experiment: str, cell: int, run: int, seed: int) -> int:
    """The seed of one run: of what is flown alone, not of who flies it or when."""
    key = (zlib.crc32(experiment.encode()), cell, run)
    low, high = np.random.SeedSequence(seed, spawn_key=key).generate_state(2)
    return int(low) + (int(high) << 32)


@lru_cache(maxsize=4)
def cell_scene(cell: Cell) -> Scene:
    """The scene of a cell, built once per process."""
    return cell.scene()


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """What the solver is asked in one run, the scene and the whole experiment's seed it was drawn from."""

    problem: Problem
    scene: Scene
    seed: int

    @cached_property
    def frames(self) -> Frames:
        """The problem's sightings, packed once for all approaches: what an approach is told does not change them."""
        return pack(self.problem)


def flown(experiment: Experiment, cell: int, run: int, seed: int) -> Flight:
    """The flight of one run."""
    what = experiment.cells[cell]
    scene = cell_scene(what)
    problem, _ = simulate(scene, noise=what.noise, seed=run_seed(experiment.name, cell, run, seed))
    return Flight(problem=without_hidden(problem, what.hidden), scene=scene, seed=seed)


def without_hidden(problem: Problem, spells: Sequence[Spell]) -> Problem:
    """The problem without the sightings of the spells, and without the frames that then see nothing."""
    if not spells:
        return problem
    cameras = []
    for number, camera in enumerate(problem.cameras):
        keep = np.ones(len(camera.rays.frame), dtype=bool)
        for spell in spells:
            if spell.camera == number:
                keep &= ~hides(spell, camera.rays.frame, camera.rays.target)
        cameras.append(_kept(camera, keep))
    return replace(problem, cameras=tuple(cameras))


def hides(spell: Spell, frame: Ints, target: Ints) -> Bools:
    """(m,) whether a spell hides these sightings of its camera."""
    return np.asarray((target == spell.target) & (frame >= spell.first) & (frame < spell.last))


def _kept(camera: CameraInput, keep: Bools) -> CameraInput:
    kept = camera.rays.some(keep)
    poses = camera.poses
    stays = np.isin(poses.frame, kept.frame)
    left = replace(
        poses, frame=poses.frame[stays], time_s=poses.time_s[stays], position_enu_m=poses.position_enu_m[stays],
        enu_from_cam=poses.enu_from_cam[stays],
    )  # fmt: skip
    return replace(camera, rays=kept, poses=left)


def told(problem: Problem, cell: Cell, approach: Approach) -> Problem:
    """The problem with the instruments' sigmas that the approach is told."""
    if approach.told is None:
        return problem
    sigma = approach.told(cell.noise).instruments
    return replace(problem, cameras=tuple(replace(c, sigma=sigma) for c in problem.cameras))


def answer(experiment: Experiment, cell: int, approach: Approach, flight: Flight) -> tuple[Answer | None, float]:
    """An approach's answer (None: the geometry does not determine one) and its seconds, start to end."""
    asked = told(flight.problem, experiment.cells[cell], approach)
    began = time.perf_counter()
    found: Answer | None = None
    try:
        if experiment.whole_calls:
            found = whole(asked, approach, experiment.target)
        elif experiment.approach(approach.name) not in refused(experiment, cell, flight.seed):
            found = straight(asked, flight.frames, approach, experiment.target)
    except GeometryError:
        pass
    return found, time.perf_counter() - began


@lru_cache(maxsize=4)
def refused(experiment: Experiment, cell: int, seed: int) -> frozenset[int]:
    """Approaches that a cell has too few equations for (section 2.4 of the paper), as its first flight shows.

    The count is of sightings and unknowns, the same in every run. Where more can be refused, `whole` calls decide.
    """
    flight = flown(experiment, cell, 0, seed)
    return frozenset(
        i
        for i, a in enumerate(experiment.approaches)
        if not _determined(told(flight.problem, experiment.cells[cell], a), a)
    )


def _determined(problem: Problem, approach: Approach) -> bool:
    try:
        find_degeneracies(problem, approach.settings)
    except GeometryError:
        return False
    return True


def fly(experiment: Experiment, cell: int, run: int, seed: int) -> Floats:
    """(approaches, measures) of one run; NaN where an approach has no answer or is left out."""
    return _measured(experiment, cell, flown(experiment, cell, run, seed))


def _measured(experiment: Experiment, cell: int, flight: Flight) -> Floats:
    """(approaches, measures) of one flight."""
    what = experiment.cells[cell]
    out = np.full((len(experiment.approaches), len(MEASURES)), np.nan)
    for i, approach in enumerate(experiment.approaches):
        if approach.name not in what.leave_out:
            found, seconds = answer(experiment, cell, approach, flight)
            out[i] = measure(found, flight.scene, experiment.target, seconds)
    return out


def fly_timed(experiment: Experiment, cell: int, runs: Sequence[int], seed: int) -> Floats:
    """(runs, approaches, measures) of several runs, the numerical solves timed as the paper timed them.

    That is approach by approach, each through all flights with nothing else in between.
    """
    flights = [flown(experiment, cell, run, seed) for run in runs]
    out = np.stack([_measured(experiment, cell, flight) for flight in flights])
    frames = [flight.frames for flight in flights]
    for i, approach in enumerate(experiment.approaches):
        for j, flight in enumerate(flights):
            if np.isfinite(out[j, i, place("solver_seconds")]):
                asked = told(flight.problem, experiment.cells[cell], approach)
                out[j, i, place("solver_seconds")] = optimum(asked, frames[j], approach)[1]
    return out
