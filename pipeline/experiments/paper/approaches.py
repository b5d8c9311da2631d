"""The ways to solve a flight that the experiments set beside each other."""

from __future__ import annotations

from pipeline.experiments.declare import Approach
from pipeline.records import SolverSettings

LI_ROUNDS = 8
"""The paper: "in simulation experiments, the Li algorithm typically requires 4-8 iterations"."""

MULTI_TI = Approach(name="Multi-TI", settings=SolverSettings(method="intersection"))
LI = Approach(name="Li", settings=SolverSettings(method="li", max_iterations=LI_ROUNDS))
LI_TO_THE_END = Approach(name="Li, to the end", settings=SolverSettings(method="li", max_iterations=500))
PLAIN_LI = Approach(name="Li, plain", settings=SolverSettings(method="li", max_iterations=LI_ROUNDS), plain=True)
PLAIN_LI_TO_THE_END = Approach(
    name="Li, plain, to the end", settings=SolverSettings(method="li", max_iterations=500), plain=True
)
ALGORITHM_1 = Approach(name="Algorithm 1", settings=SolverSettings(method="algorithm-1"))
ALGORITHM_2 = Approach(name="Algorithm 2", settings=SolverSettings(method="algorithm-2"))
TRIANGULATION = Approach(name="triangulation", settings=SolverSettings(method="triangulation"))
INTERSECTION = Approach(name="intersection", settings=SolverSettings(method="intersection"))
MAP = Approach(name="map", settings=SolverSettings(method="map"), ours=True)

ABOUT_LI = (
    f'Li stops after {LI_ROUNDS} rounds, as many as the paper reports for it ("typically 4-8 iterations"); a round is '
    "an intersection and a descent in every offset. Run until nothing moves it reaches the "
    "minimum of Algorithm 1's cost with frame rates held, so whatever separates the two is how far it is run, and "
    "whether the frame rate may move: with the right rate held Li has an unknown less, and can be the better one."
)
