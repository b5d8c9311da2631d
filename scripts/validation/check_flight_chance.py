"""Coverage of a single flight is itself left to chance: how it would fall out if the claimed sigmas were exactly true.

usage: python -m scripts.validation.check_flight_chance FLIGHT.toml [--draws 300]

A flight's errors share few causes (its cameras' given positions move all of it together), so that one flight does not
cover 68 and 95 % even where every sigma is right. The flight is solved; errors are drawn from the claimed
(cluster-robust) covariance of all unknowns together; of each draw the coverage is counted per axis, ten times a second
while two cameras look, as `check_flights.py` counts it against RTK. Tracks must be files.
"""

import argparse
from pathlib import Path

import numpy as np

from pipeline.flight import read_flight
from pipeline.records import Problem, SolverSettings
from pipeline.solver.adjustment.renewal import renewing
from pipeline.solver.methods.initialisation import candidates
from pipeline.solver.methods.map_estimation import adjust, outcome
from pipeline.solver.methods.results import Outcome
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import pack
from pipeline.solver.uncertainty.covariance import Sandwich
from pipeline.stages import build_problem, measure_poses, open_sources, read_models
from pipeline.stages.inputs.tracks import read_tracks
from scripts.validation.figures import tell

SUPPORT_S, STEP_S = 0.2, 0.1
WITHIN = ((1.0, 55, 80), (1.96, 88, 99))
"""Sigmas, and the percentages between which coverage might be asked to lie."""


def given(path: Path) -> Problem:
    """The problem of a flight whose tracks are files."""
    flight = read_flight(path)
    tracks = read_tracks(flight, path.parent / "out")
    measured = measure_poses(flight, open_sources(flight), tracks)
    return build_problem(flight, tracks, measured, read_models(flight)).problem


def looked_at(found: Outcome) -> list[np.ndarray]:  # type: ignore[type-arg]
    """For every target, the common times at which at least two cameras see it."""
    frames, state = found.model.frames, found.state
    time = common_time_s(frames, found.model.drift, state.camera, state.deviation)
    out = []
    for n in range(len(frames.targets)):
        grid = np.arange(time.min(), time.max(), STEP_S)
        cameras = np.zeros(len(grid), dtype=int)
        for c in range(len(frames.cameras)):
            seen = np.sort(time[frames.of(c)][frames.seen[frames.of(c), n]])
            cameras += np.searchsorted(seen, grid + SUPPORT_S) > np.searchsorted(seen, grid - SUPPORT_S)
        out.append(grid[cameras >= 2])
    return out


def main() -> None:
    """Prints percentiles of the coverage, and how often it lies where it might be asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flight", type=Path)
    parser.add_argument("--draws", type=int, default=300)
    asked = parser.parse_args()
    problem, settings = given(asked.flight), SolverSettings()
    found = outcome(adjust(problem, settings, pack(problem), candidates(problem, settings), None, renewing(problem)))
    assert isinstance(found.robust, Sandwich)
    model, place, rng = found.model, found.model.order.coefficient, np.random.default_rng(0)
    for n, (target, times) in enumerate(zip(model.frames.targets, looked_at(found), strict=True)):
        errors = np.empty((asked.draws, len(times), 3))
        for k in range(asked.draws):
            unknowns = found.robust.columns @ rng.normal(size=found.robust.columns.shape[1])
            errors[k] = model.basis.position(times, np.where(place >= 0, unknowns[place], 0.0))[:, n]
        ratio = np.abs(errors) / np.sqrt((errors**2).mean(axis=0))
        good = np.ones(asked.draws, dtype=bool)
        print(f"{target}: {len(times)} times, {asked.draws} draws")
        told = {}
        for sigmas, least, most in WITHIN:
            share = 100 * (ratio < sigmas).mean(axis=(1, 2))
            inside = (share >= least) & (share <= most)
            good &= inside
            low, middle, high = np.percentile(share, [2.5, 50, 97.5])
            told[f"within {sigmas} sigmas"] = {"low_percent": low, "median_percent": middle, "high_percent": high}
            print(
                f"  within {sigmas} sigmas: {low:.0f} to {high:.0f} % in 95 of 100 such flights, median {middle:.0f};"
                f" {least} to {most} % in {100 * inside.mean():.0f} of 100"
            )
        tell({target: told})
        print(f"  both at once in {100 * good.mean():.0f} of 100")


if __name__ == "__main__":
    main()
