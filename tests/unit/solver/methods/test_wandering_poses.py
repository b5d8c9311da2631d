"""Pose errors that last: how much of a claim is new in every frame, and what a descent with a process begins from."""

from dataclasses import replace

import numpy as np

from pipeline.solver.adjustment.levenberg_marquardt import levenberg_marquardt
from pipeline.solver.adjustment.model import pose_error
from pipeline.solver.methods.wandering_poses import Parts, _parted
from pipeline.solver.observation.pose_wander import wander_knots
from scripts.validation import check_ordinary_flights as ordinary
from tests.scenes.solver import rich_model


def hovering(common, duration, rng, heading, distance, height):
    place = [distance * np.cos(heading), distance * np.sin(heading), height]
    return np.tile(place, (len(common), 1)) + ordinary._wander(common, rng, 0.5)


def test_a_walk_of_positions_does_not_shrink_the_scene(monkeypatch):
    """Receivers that claim 1 m new in every frame and walk instead: the scene shrank by 60 m, 7 claims."""
    monkeypatch.setattr(ordinary, "_grade", lambda rng: {})
    monkeypatch.setattr(ordinary, "_kinds", lambda rng, count: ("straight", "stop", "parked"))
    monkeypatch.setattr(ordinary, "_flown", hovering)
    monkeypatch.setattr(ordinary, "MOST_FRAMES", 200)
    flight = ordinary.drawn(3, "gnss10", cameras=2, duration_s=20)
    score, solution = ordinary.solved(flight, ordinary.with_true_motion(flight))
    assert any(f.kind == "wandering-poses" for f in solution.findings)
    assert score.rmse_m < 20
    assert score.ratio < 2
    assert score.offset_sigmas < 3
    assert solution.verdict.grade == "good"


def test_a_descent_with_a_process_begins_with_the_poses_where_they_are():
    model, state = rich_model(drift=False)
    fit = levenberg_marquardt(model, state)
    sigma, tau = np.zeros((2, 6)), np.full((2, 6), 2.0)
    sigma[1] = model.pose.spread[1]
    wander, spread = wander_knots(model.frames, sigma, tau), model.pose.spread * 0.3
    own, knots = _parted(fit, wander, spread)
    assert np.abs(knots).max() > 0
    later = model.changed(wander=wander, pose=replace(model.pose, spread=spread))
    moved = pose_error(later, replace(fit.state, own=own, wander=knots), slice(None))
    np.testing.assert_allclose(moved, pose_error(fit.model, fit.state, slice(None)), atol=1e-12)


def test_what_is_no_longer_new_lasts():
    claimed = Parts(
        new=np.array([1.0, 1, 1, 0.3, 0.3, 0.3]), lasting=np.sqrt(1 - np.array([1.0, 1, 1, 0.09, 0.09, 0.09]))
    )
    less = claimed.reduced(Parts(new=np.array([1.0, 1, 1, 0.5, 0.5, 0.5]), lasting=np.zeros(6)))
    np.testing.assert_allclose(less.new[3:], 0.15)
    np.testing.assert_allclose(less.new**2 + less.lasting**2, 1)
