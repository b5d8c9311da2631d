"""Where one camera alone sees a target that moves freely, its distance is nobody's to know: it is left out and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.records import Problem, SolverSettings, TargetInput
from pipeline.solver import solve
from pipeline.solver.methods.lone_stretches import REACH_S, lone
from pipeline.solver.observation.clocks import common_time_s
from pipeline.solver.observation.observations import pack
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import PAPER_LOW, simulate
from tests.scenes.solver import rich_model

FROM, UNTIL = 1.0, 3.0
"""Seconds of its video within which uav2 sees its targets at all."""


def partly_seen(motion: str, order: int = 1) -> Problem:
    problem, _ = simulate(paper_scene(order=order, targets=2, given_offset_s=0.5), noise=PAPER_LOW, seed=3)
    camera = problem.cameras[1]
    rays = camera.rays
    kept = (rays.time_s >= FROM) & (rays.time_s < UNTIL)
    shown = np.isin(camera.poses.frame, np.unique(rays.frame[kept]))
    poses = replace(
        camera.poses, frame=camera.poses.frame[shown], time_s=camera.poses.time_s[shown],
        position_enu_m=camera.poses.position_enu_m[shown], enu_from_cam=camera.poses.enu_from_cam[shown],
    )  # fmt: skip
    fewer = replace(
        rays, target=rays.target[kept], frame=rays.frame[kept], time_s=rays.time_s[kept],
        direction_cam=rays.direction_cam[kept], pixel_from_ray=rays.pixel_from_ray[kept], sigma_px=rays.sigma_px[kept],
    )  # fmt: skip
    targets = tuple(TargetInput(target=t.target, motion=motion) for t in problem.targets)  # type: ignore[arg-type]
    return replace(problem, cameras=(problem.cameras[0], replace(camera, rays=fewer, poses=poses)), targets=targets)


def test_a_curve_that_was_found_ends_where_two_cameras_see_it():
    solution = solve(partly_seen("auto", order=2), SolverSettings())
    assert all(m.kind == "spline" or m.degree > 1 for m in solution.motions)
    assert max(m.end_s for m in solution.motions) < UNTIL + 0.5 + REACH_S
    assert [r.grade for r in solution.verdict.reasons if r.kind == "seen-by-one"] == ["good"]


def test_sightings_far_from_any_other_camera_s_are_lone():
    frames = pack(partly_seen("spline"))
    model, state = rich_model(drift=False)
    time = frames.video_s + np.where(frames.camera == 1, 0.53, 0.0)
    found = lone(frames, time)
    near = (time > FROM + 0.53 - REACH_S) & (time < UNTIL + 0.53 - 0.1 + REACH_S)
    np.testing.assert_array_equal(found.sighting.any(axis=1), ~near)
    hidden = found.without(frames, [0])
    assert (hidden.seen[:, 1] == frames.seen[:, 1]).all()
    assert not (hidden.seen[:, 0] & found.sighting[:, 0]).any()
    own = common_time_s(model.frames, model.drift, state.camera, state.deviation)
    assert not lone(model.frames, own).sighting.any()


@pytest.mark.parametrize(("motion", "ends"), [("spline", True), ("auto", False)])
def test_a_spline_ends_there_and_a_polynomial_goes_on(motion, ends):
    solution = solve(partly_seen(motion), SolverSettings())
    longest = max(m.end_s for m in solution.motions)
    said = [r for r in solution.verdict.reasons if r.kind == "seen-by-one"]
    assert (longest < UNTIL + 0.5 + REACH_S) == ends
    assert bool(said) == ends
    if ends:
        assert "target1, target2" in said[0].words
        assert said[0].grade == "good"
