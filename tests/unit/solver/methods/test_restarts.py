"""Other starts: the best is taken, and one that ends nowhere costs no answer."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.solver.adjustment.levenberg_marquardt import levenberg_marquardt
from pipeline.solver.methods import map_estimation, restarts
from pipeline.solver.methods.restarts import Settled, Start, best_of
from pipeline.solver.observation.clocks import OFFSET
from tests.scenes.solver import rich_model


@pytest.fixture(scope="module")
def fit():
    return levenberg_marquardt(*rich_model(drift=False))


def singular(_=None):
    raise np.linalg.LinAlgError("Singular matrix")


def test_a_start_without_a_finite_answer_is_told_and_passed_over(fit, monkeypatch):
    starts = [Start(words="other offsets (b +1.00 s)", run=singular), Start(words="parabolas first", run=lambda: fit)]
    monkeypatch.setattr(restarts, "_others", lambda *_: iter(starts))
    doubtful = Settled(fit=replace(fit, status="iteration-limit"))
    best, told = best_of(doubtful, None, (), (), lambda found: Settled(fit=found))
    assert best.fit.cost == fit.cost
    assert "other offsets (b +1.00 s): no finite answer" in told[0].words


def test_an_adjustment_that_cannot_settle_is_not_believed(fit):
    found = map_estimation._settled(fit, singular)
    assert found.fit.status == "stalled"
    assert restarts.is_doubtful(found.fit)


def test_an_end_that_converged_is_taken_before_one_whose_cost_is_lower(fit, monkeypatch):
    """What collapsed costs less: residuals vanish where videos do not overlap, or a scene has shrunk."""
    start = Start(words="other offsets (b +1.00 s)", run=lambda: fit)
    monkeypatch.setattr(restarts, "_others", lambda *_: iter([start]))
    monkeypatch.setattr(restarts, "_worth", lambda found: 0.0 if found.status == "stalled" else 100.0)
    collapsed = Settled(fit=replace(fit, status="stalled"))
    best, told = best_of(collapsed, None, (), (), lambda found: Settled(fit=found))
    assert best.fit.status == "converged"
    assert told[0].words.endswith("Taken: other offsets (b +1.00 s)")


def test_an_end_in_which_a_camera_looks_alone_is_taken_last(fit, monkeypatch):
    camera = fit.state.camera.copy()
    camera[-1, OFFSET] += 1e4
    alone = replace(fit, status="stalled", linear=replace(fit.linear, state=replace(fit.state, camera=camera)))
    other = replace(fit, status="iteration-limit")
    assert restarts.looks_alone(alone)
    assert not restarts.looks_alone(other)
    start = Start(words="other offsets (b +1.00 s)", run=lambda: other)
    monkeypatch.setattr(restarts, "_others", lambda *_: iter([start]))
    monkeypatch.setattr(restarts, "_worth", lambda found: 0.0 if found.status == "stalled" else 100.0)
    best, _ = best_of(Settled(fit=alone), None, (), (), lambda found: Settled(fit=found))
    assert best.fit.status == "iteration-limit"
