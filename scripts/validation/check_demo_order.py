"""The demo's scene with drawn tracks and poses, no video: mean position error of every method over some seeds.

usage: python -m scripts.validation.check_demo_order [SEEDS]        (default 10)
"""

import sys
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.records import Problem, Solution, SolverSettings, Truth
from pipeline.records.problem import Method
from pipeline.solver import solve
from pipeline.synthetic.demo_scenes import demo_scene
from pipeline.synthetic.simulate import DEMO, simulate
from scripts.validation.figures import tell

METHODS: tuple[Method, ...] = ("intersection", "li", "algorithm-1", "algorithm-2", "map")


def mean_error_m(solution: Solution, truth: Truth) -> float:
    """Mean distance between found and true position, over the time in which each target was seen."""
    errors = []
    for true in truth.trajectories:
        motion = solution.motion(true.target)
        time = np.linspace(motion.start_s, motion.end_s, 50)
        true_m = CubicSpline(true.time_s, true.position_enu_m)(time)
        errors.append(np.linalg.norm(motion.position_enu_m(time) - true_m, axis=1).mean())
    return float(np.mean(errors))


def unsynchronised(problem: Problem) -> Problem:
    """The same with nothing known of the second clock."""
    cameras = (problem.cameras[0], *(replace(c, offset_s=None) for c in problem.cameras[1:]))
    return replace(problem, cameras=cameras)


def method_errors(seed: int, methods: tuple[Method, ...] = METHODS) -> dict[Method, float]:
    """Mean error of each method on one drawn flight."""
    problem, truth = simulate(demo_scene(), noise=DEMO, seed=seed)
    asked = unsynchronised(problem)
    return {m: mean_error_m(solve(asked, SolverSettings(method=m)), truth) for m in methods}


def main(seeds: int = 10) -> None:
    """Prints a row per seed and the means."""
    rows = [method_errors(seed) for seed in range(seeds)]
    print("seed  " + "".join(f"{m:>14}" for m in METHODS) + "   (mean error, m)")
    for seed, row in enumerate(rows):
        print(f"{seed:<6}" + "".join(f"{row[m]:>14.3f}" for m in METHODS))
    means = {m: float(np.mean([row[m] for row in rows])) for m in METHODS}
    print("mean  " + "".join(f"{means[m]:>14.3f}" for m in METHODS))
    tell({"flights": seeds, "mean_error_m": means})


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
