"""One flight's true trajectory and every approach's, to be drawn (paper Fig. 9 and 11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats
from pipeline.experiments.declare import Experiment
from pipeline.experiments.flying.flights import answer, flown

SAMPLES = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownPath:
    """True path (n, 3) over the first camera's time, and found paths by the approach's number."""

    cell: int
    true_m: Floats
    found_m: tuple[tuple[int, Floats], ...]


def fly_path(experiment: Experiment, cell: int, seed: int) -> FlownPath:
    """Run 0 of a cell, solved by every approach."""
    flight = flown(experiment, cell, 0, seed)
    scene = flight.scene
    first = scene.cameras[0].frame_time_s(np.array([0, scene.cameras[0].frames - 1]))
    time = np.linspace(first[0], first[1], SAMPLES)
    found = []
    for i, approach in enumerate(experiment.approaches):
        solved, _ = answer(experiment, cell, approach, flight)
        if solved is not None:
            found.append((i, solved.motion.position_enu_m(time)))
    true_m = scene.targets[experiment.target].motion.position_enu_m(time)
    return FlownPath(cell=cell, true_m=true_m, found_m=tuple(found))
