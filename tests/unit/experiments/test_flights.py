"""Seeds, hidden sightings, and the measure of an answer."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import UsageError
from pipeline.experiments import EXPERIMENTS, experiment_named
from pipeline.experiments.declare import Grid, Path3D, Spell
from pipeline.experiments.flying.answers import optimum
from pipeline.experiments.flying.flights import (
    answer,
    cell_scene,
    flown,
    fly,
    fly_timed,
    refused,
    run_seed,
    told,
    without_hidden,
)
from pipeline.experiments.flying.measure import MEASURES, place, viewpoint_errors
from pipeline.experiments.paper.approaches import LI, LI_TO_THE_END, MAP, MULTI_TI, PLAIN_LI, PLAIN_LI_TO_THE_END
from pipeline.experiments.paper.counts import occlusion, solvable
from pipeline.experiments.statistics.figures import FIGURES, words
from pipeline.experiments.statistics.summary import estimate
from pipeline.solver.observation.clocks import OFFSET
from pipeline.synthetic.scene import camera_pose


def test_every_run_of_every_cell_has_its_own_seed():
    seeds = {run_seed(e, c, r, s) for e in ("offset", "speed") for c in range(3) for r in range(3) for s in (1, 2)}
    assert len(seeds) == 36
    assert run_seed("offset", 2, 1, 7) == run_seed("offset", 2, 1, 7)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_whole(name):
    e = experiment_named(name)
    assert e.name == name
    assert e.title
    assert e.geometry
    assert e.reference in [a.name for a in e.approaches]
    names = {a.name for a in e.approaches}
    for cell in e.cells:
        assert set(cell.published) <= names
        assert cell.values.keys() == e.cells[0].values.keys()
    for drawing in e.drawings:
        if isinstance(drawing, Path3D):
            assert drawing.cell < len(e.cells)
        if isinstance(drawing, Grid):
            assert drawing.measure in FIGURES


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(UsageError, match="'accuracy'"):
        experiment_named("acuracy")


def test_hidden_sightings_leave_the_problem_and_nothing_else():
    problem = flown(occlusion(), 0, 0, 1).problem
    spells = tuple(Spell(camera=1, target=t, first=5, last=15) for t in range(4))
    less = without_hidden(problem, spells)
    assert less.cameras[0] is problem.cameras[0] or len(less.cameras[0].rays.frame) == len(
        problem.cameras[0].rays.frame
    )
    assert not np.isin(np.arange(5, 15), less.cameras[1].rays.frame).any()
    assert set(less.cameras[1].poses.frame) == set(less.cameras[1].rays.frame)
    one = without_hidden(problem, spells[:1])
    assert set(one.cameras[1].poses.frame) == set(problem.cameras[1].poses.frame)
    assert len(one.cameras[1].rays.frame) == len(problem.cameras[1].rays.frame) - 10


def test_occlusion_hides_the_stated_share():
    for cell in occlusion().cells:
        hidden = sum(s.last - s.first for s in cell.hidden)
        assert hidden == pytest.approx(cell.values["hidden_share"] * 2 * 4 * 50)


def test_a_wrong_clock_costs_what_it_moves_the_target():
    e = experiment_named("synchronised")
    cell = replace(e.cells[-1], noise=replace(e.cells[-1].noise, pixel_px=1e-6, attitude_bias_rad=0.0, attitude_rad=0.0,
                                              position_bias_m=0.0, position_m=0.0))  # fmt: skip
    quiet = replace(e, cells=(cell,))
    quiet = replace(quiet, approaches=(MULTI_TI, MAP))
    flight = flown(quiet, 0, 0, 1)
    scene = flight.scene
    wrong, _ = answer(quiet, 0, MULTI_TI, flight)
    right, _ = answer(quiet, 0, MAP, flight)
    assert np.linalg.norm(viewpoint_errors(right, scene, 0), axis=1).max() < 0.01
    # one second at 9.1 m/s, shared by both cameras
    assert 3.0 < np.linalg.norm(viewpoint_errors(wrong, scene, 0), axis=1).mean() < 9.1
    assert wrong.offset_s - scene.cameras[1].offset_s == pytest.approx(1.0)


def test_what_an_approach_is_told_is_not_what_is_flown():
    e = experiment_named("priors")
    problem = flown(e, 0, 0, 1).problem
    for approach in e.approaches[1:]:
        asked = told(problem, e.cells[0], approach)
        assert asked.cameras[0].sigma != problem.cameras[0].sigma
        assert asked.cameras[0].rays is problem.cameras[0].rays


@pytest.mark.parametrize("name", [n for n in EXPERIMENTS if n not in ("speed", "monocular", "long-range")])
def test_the_straight_way_answers_as_the_whole_call_does(name):
    e = experiment_named(name)
    cells = {0, len(e.cells) - 1}
    for cell in cells:
        straight, whole = fly(e, cell, 1, 3), fly(replace(e, refused=True), cell, 1, 3)
        figures = slice(0, place("seconds"))
        np.testing.assert_array_equal(straight[:, figures], whole[:, figures])


def test_too_few_equations_are_refused_in_every_run():
    e = experiment_named("occlusion")
    base = e.approach("Algorithm 2")
    assert refused(e, 4, 1) == {base}
    assert refused(e, 0, 1) == frozenset()
    assert [np.isnan(fly(e, 4, run, 1)[base, place("error_m")]) for run in range(2)] == [True, True]


def test_no_answer_is_no_figure():
    e = experiment_named("monocular")
    still = next(i for i, c in enumerate(e.cells) if c.values["case"] == "straight")
    quiet = replace(e.cells[still].noise, pixel_px=1e-9, attitude_bias_rad=0.0, attitude_rad=0.0, position_bias_m=0.0,
                    position_m=0.0)  # fmt: skip
    out = fly(replace(e, cells=(replace(e.cells[still], noise=quiet),)), 0, 0, 1)
    assert out.shape == (2, len(MEASURES))
    assert np.isnan(out[0, place("error_m")]) or out[0, place("error_m")] > 1.0
    assert np.isfinite(out[:, place("seconds")]).all()


def test_the_papers_count_of_equations():
    assert solvable(1, 1, 2, 100) == "no"
    assert solvable(2, 1, 2, 16) == "yes"
    assert solvable(2, 1, 2, 15) == "no"


def test_estimates_pass_over_what_has_no_answer():
    e = estimate(np.array([1.0, np.nan, 3.0]))
    assert (e.mean, e.deviation) == (2.0, pytest.approx(np.sqrt(2)))
    assert e.error == pytest.approx(1.0)
    assert np.isnan(estimate(np.array([np.nan])).mean)


def test_numbers_for_people():
    assert [words(v) for v in (3.14159, 0.0, 1234.5, -0.5, float("nan"), 1e-7)] == [
        "3.14", "0.00", "1234", "\u22120.500", "\u2013", "1.0e\u221207",
    ]  # fmt: skip


def test_scenes_keep_their_targets_in_view():
    for name in ("rotation", "long-range", "cameras"):
        scene = cell_scene(experiment_named(name).cells[-1])
        problem = flown(experiment_named(name), len(experiment_named(name).cells) - 1, 0, 1).problem
        full = sum(c.frames for c in scene.cameras) * len(scene.targets)
        assert sum(len(c.rays.frame) for c in problem.cameras) > 0.9 * full


def test_the_long_range_flight_is_the_papers():
    scene = experiment_named("long-range").cells[0].scene()
    for camera in scene.cameras:
        time = camera.frame_time_s(np.arange(camera.frames))
        centre, _ = camera_pose(camera.platform, time)
        for target in scene.targets:
            away = np.linalg.norm(centre - target.motion.position_enu_m(time), axis=1)
            assert 15_000 < away.min() < away.max() < 20_000
    here, there = (c.platform.position_enu_m.value for c in scene.cameras)
    np.testing.assert_allclose(np.linalg.norm(there - here, axis=1), 20_000)
    assert scene.cameras[1].offset_s == -40 / 25
    for target in scene.targets:
        speed_kmh = 3.6 * np.linalg.norm(target.motion.position_enu_m(np.array([5.0]), 1))
        assert speed_kmh == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("name", "cell", "run"),
    [("speed", 0, 1), ("speed", 1, 2), ("rotation", 0, 0)],
    ids=["line", "curve", "four"],
)
def test_plain_li_goes_where_ours_goes(name, cell, run):
    """NumPy and MINPACK share nothing with the solver but the sightings."""
    flight = flown(experiment_named(name), cell, run, 1)
    for ours, plain in ((LI, PLAIN_LI), (LI_TO_THE_END, PLAIN_LI_TO_THE_END)):
        (mine, _), (theirs, _) = (optimum(flight.problem, flight.frames, a) for a in (ours, plain))
        assert theirs.state.camera[1, OFFSET] == pytest.approx(mine.state.camera[1, OFFSET], abs=2e-4)
        np.testing.assert_allclose(theirs.cost, mine.cost, rtol=1e-5)


def test_solves_are_timed_apart_and_change_no_answer():
    e = experiment_named("speed")
    timed, alone = fly_timed(e, 0, range(2), 1), fly(e, 0, 1, 1)
    free = [i for i, name in enumerate(MEASURES) if "seconds" not in name]
    np.testing.assert_array_equal(timed[1][:, free], alone[:, free])
    assert (timed[..., place("solver_seconds")] > 0).all()
