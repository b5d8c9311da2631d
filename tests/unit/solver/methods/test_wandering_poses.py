"""Pose errors that last: a process is taken where the data are likelier with it."""

import numpy as np
import pytest

from pipeline.solver.adjustment.levenberg_marquardt import levenberg_marquardt
from pipeline.solver.methods import wandering_poses
from pipeline.solver.methods.wandering_poses import CLEARLY, Parts, with_wandering_poses
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from tests.scenes.solver import rich_model


@pytest.mark.parametrize(("gain", "taken"), [(-200.0, False), (CLEARLY - 1, False), (CLEARLY + 1, True)])
def test_a_process_that_makes_the_data_less_likely_is_not_taken(monkeypatch, gain, taken):
    """Claims that nothing made left a scene free to shrink until its normal equations had no inverse."""
    problem, _ = simulate(paper_scene(order=1, targets=1), noise=PAPER_LOW, seed=1)
    fit = levenberg_marquardt(*rich_model(drift=False))
    found = levenberg_marquardt(*rich_model(drift=False))
    parts = Parts(new=np.full(6, 0.3), lasting=np.full(6, 0.95))
    monkeypatch.setattr(wandering_poses, "_missing", lambda *_: parts)
    monkeypatch.setattr(wandering_poses, "_with", lambda *_: found)
    monkeypatch.setattr(wandering_poses, "_helped", lambda _: True)
    monkeypatch.setattr(wandering_poses, "likelihood", lambda of: gain if of is found else 0.0)
    best, told = with_wandering_poses(problem, fit, lambda *_: found)
    assert best is (found if taken else fit)
    assert bool(told) is taken
