"""The verdict on map, and ratios with their intervals, on outcomes made up so that the answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.experiments import experiment_named
from pipeline.experiments.flying.measure import MEASURES, place
from pipeline.experiments.pages.page import render_page
from pipeline.experiments.statistics.ratios import of_means, of_medians
from pipeline.experiments.statistics.summary import cell_bounds, summarise
from pipeline.experiments.statistics.verdict import sentence, verdict

RUNS = 200


def made_up(**over_bound):
    """`rotation`'s first cell with errors of so many times the bound by approach, as normal errors have them."""
    e = experiment_named("rotation")
    e = replace(e, cells=e.cells[:1])
    limit = cell_bounds(e, 0)
    axis = limit[0].rms_m() / np.sqrt(3)
    rng = np.random.default_rng(2)
    shared = rng.normal(size=(RUNS, 3))
    runs = np.zeros((1, RUNS, len(e.approaches), len(MEASURES)))
    for i, approach in enumerate(e.approaches):
        factor = over_bound.get(approach.name.replace(" ", "_").replace("-", "_"), 2.0)
        errors = factor * axis * (shared + 0.1 * rng.normal(size=(RUNS, 3)))
        runs[0, :, i, place("error_m")] = np.linalg.norm(errors, axis=1)
        runs[0, :, i, place("square_m2")] = (errors**2).sum(axis=1)
    return summarise(e, runs, 1, {0: limit}, {})


def test_a_map_on_the_bound_is_the_best():
    outcome = made_up(map=1.0)
    found = verdict(outcome)
    assert (found.better, found.equal, found.worse, found.missed) == (4, 0, (), ())
    assert "nearer the truth in 4" in sentence(outcome)
    assert "farther in 0" in render_page(outcome)


def test_a_map_that_is_beaten_is_named():
    outcome = made_up(map=2.0, Algorithm_2=1.8)
    found = verdict(outcome)
    assert [outcome.experiment.approaches[e.approach].name for e in found.worse] == ["Algorithm 2"]
    assert found.compared == 4
    assert "Algorithm 2 is nearer the truth by" in render_page(outcome)


def test_no_better_where_there_is_room_is_told_from_no_better_on_the_bound():
    room = verdict(made_up(map=2.0, Algorithm_2=2.0, Algorithm_1=3.0, Li=3.0, Multi_TI=3.0))
    assert room.equal == 1
    assert len(room.missed) == 1
    none = verdict(made_up(map=1.0, Algorithm_2=1.0))
    assert none.equal == 1
    assert none.missed == ()


def test_the_interval_of_a_ratio_holds_the_true_one():
    outcome = made_up(map=1.0, Algorithm_1=2.0)
    ours = outcome.entry(0, outcome.experiment.approach("map"))
    for ratio in (of_means(outcome, ours, "Algorithm 1"), of_medians(outcome, ours, "Algorithm 1")):
        assert ratio.low < 0.5 < ratio.high
        assert ratio.high - ratio.low < 0.1
        assert np.isnan(ratio.published)
    second = outcome.entry(0, outcome.experiment.approach("Algorithm 2"))
    assert of_means(outcome, second, "Algorithm 1").published == pytest.approx(1.0085 / 3.1392)


def test_intervals_hold_the_truth_as_often_as_they_say():
    outcome = made_up(map=1.0, Algorithm_1=2.0)
    e, base = outcome.experiment, outcome.experiment.approach("Algorithm 1")
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(300):
        runs = np.zeros((1, 100, len(e.approaches), len(MEASURES)))
        theirs = rng.gamma(4.0, size=100)
        runs[0, :, base, place("error_m")] = theirs
        runs[0, :, e.approach("map"), place("error_m")] = 0.5 * theirs + rng.normal(scale=0.5, size=100)
        ratio = of_means(replace(outcome, runs=runs), outcome.entry(0, e.approach("map")), "Algorithm 1")
        held += ratio.low < 0.5 < ratio.high
    assert 0.90 < held / 300 < 0.985
