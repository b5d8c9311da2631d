"""The paper's experiments, flown again with this project's methods beside the paper's.

An experiment is data (`declare`): scenes, noise, approaches, published figures, and how its page looks. One runner
flies it on any number of processes with the same numbers, one measure holds every answer against the truth, and the
Cramer-Rao bound, computed apart from the solver, stands beside every cell.
"""

from pipeline.experiments.paper.catalogue import EXPERIMENTS, experiment_named
from pipeline.experiments.run import run_experiment, run_experiments, write_outcome
from pipeline.experiments.running.cluster import cluster
from pipeline.experiments.running.runner import processes
from pipeline.experiments.statistics.summary import Entry, Outcome
from pipeline.experiments.statistics.verdict import sentence, verdict

__all__ = [
    "EXPERIMENTS",
    "Entry",
    "Outcome",
    "cluster",
    "experiment_named",
    "processes",
    "run_experiment",
    "run_experiments",
    "sentence",
    "verdict",
    "write_outcome",
]
