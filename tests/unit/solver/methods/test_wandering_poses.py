"""Pose errors that last: a process is taken where the data are likelier with it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import SolverSettings
from pipeline.solver import solve
from pipeline.solver.adjustment.levenberg_marquardt import levenberg_marquardt
from pipeline.solver.judgement.changes import stepped
from pipeline.solver.methods import wandering_poses
from pipeline.solver.methods.parameters import first_camera, first_choice, first_model
from pipeline.solver.methods.wandering_poses import CLEARLY, MISSED, Parts, begun, smooth_parts, with_wandering_poses
from pipeline.solver.observation.observations import pack
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from scripts.validation.check_ordinary_flights import drawn, score
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


def test_claims_that_the_measured_poses_bear_stay_new_in_every_frame():
    """White errors of a metre and half a degree, as claimed."""
    problem = drawn(6203).problem
    assert smooth_parts(problem) == {}
    model, state = rich_model(drift=False)
    assert begun(problem, model, state) == (model, state)


def test_poses_smoother_than_their_claim_are_taken_to_last():
    """A walk of 1 m in 10 s beside white attitudes: a tenth of the metre is new, all of the turns."""
    parts = smooth_parts(drawn(6200, "gnss10").problem)
    assert set(parts) == {0, 1}
    for part in parts.values():
        assert part.process == MISSED
        assert part.new[:3] == pytest.approx(1)
        assert np.all(part.new[3:] < 0.2)
        np.testing.assert_allclose(part.new[3:] ** 2 + part.lasting[3:] ** 2, 1)
        assert not part.lasting[:3].any()


def test_instruments_that_say_how_long_errors_last_are_believed():
    """`position_tau_s = 0`: new in every frame, however smooth."""
    problem = drawn(6200, "gnss10").problem
    said = tuple(replace(c, sigma=replace(c.sigma, position_tau_s=0.0, attitude_tau_s=0.0)) for c in problem.cameras)
    assert smooth_parts(replace(problem, cameras=said)) == {}


@pytest.mark.parametrize(("walk", "seed"), [("gnss10", 6200), ("gnss10", 6303)])
def test_flights_whose_receivers_walk_come_out_within_their_claims(walk, seed):
    """6200 was 133 m off: nothing made what was claimed new in every frame, and the scene shrank."""
    flight = drawn(seed, walk)
    solution = solve(flight.problem, SolverSettings())
    found = score(flight, solution, 0.0)
    assert solution.verdict.grade == "good"
    assert 0.1 < found.ratio < 2.5
    assert found.offset_sigmas < 3
    assert {f.subject for f in solution.findings if f.kind == "wandering-poses"} >= {"uav1", "uav2"}


def test_poses_that_are_new_in_every_frame_after_all_have_no_process():
    """A process without knots was left, and a camera tried in two parts had none of its own in it."""
    problem = drawn(6200, "gnss10").problem
    frames = pack(problem)
    choice = first_choice(problem)
    model, state = first_model(problem, SolverSettings(), frames, choice, first_camera(problem, {}, {}))
    lasting, begun_state = begun(problem, model, state)
    assert lasting.wander.count == len(begun_state.wander) > 0
    white, white_state = wandering_poses._processed(problem, lasting, begun_state, {}, MISSED)
    assert white.wander is None
    assert white_state.wander.shape == (0, 6)
    np.testing.assert_array_equal(white.pose.spread, model.pose.spread)
    assert stepped(white, 0, int(frames.frame[frames.of(0)][40]), "position").apply(white).frames.cameras[:2] == (
        "uav1", "uav1",
    )  # fmt: skip
