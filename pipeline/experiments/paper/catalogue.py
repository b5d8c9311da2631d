"""All experiments by name, each built when it is asked for."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from functools import cache

from calibration.foundation.errors import UsageError
from pipeline.experiments.declare import Experiment
from pipeline.experiments.paper import basic as basic_experiments
from pipeline.experiments.paper import clocks as clock_experiments
from pipeline.experiments.paper import counts as count_experiments
from pipeline.experiments.paper import limits as limit_experiments
from pipeline.experiments.paper import rotations as rotation_experiments

EXPERIMENTS: dict[str, Callable[[], Experiment]] = {
    "offset": clock_experiments.offset,
    "accuracy": clock_experiments.accuracy,
    "frame-rate": clock_experiments.frame_rate,
    "speed": clock_experiments.speed,
    "rotation": rotation_experiments.rotation,
    "long-range": rotation_experiments.far,
    "synchronised": basic_experiments.synchronised,
    "monocular": basic_experiments.monocular,
    "occlusion": count_experiments.occlusion,
    "targets": count_experiments.targets,
    "cameras": count_experiments.cameras,
    "bound": limit_experiments.bound,
    "priors": limit_experiments.priors,
}


@cache
def experiment_named(name: str) -> Experiment:
    """The experiment of that name. Raises UsageError where there is none."""
    if name not in EXPERIMENTS:
        near = difflib.get_close_matches(name, EXPERIMENTS, n=1)
        raise UsageError(
            where="experiment", seen=f"{name!r}", expected="one of " + ", ".join(EXPERIMENTS),
            advice=f"'{near[0]}'" if near else "runningfix experiment list",
        )  # fmt: skip
    return EXPERIMENTS[name]()
