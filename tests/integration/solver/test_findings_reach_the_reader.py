"""What the geometry leaves open, from the sightings through `solve` to solution.json and the report's words."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import GeometryError
from pipeline.export import solution_json
from pipeline.records import Problem, SolverSettings
from pipeline.report.views.summary import remarks
from pipeline.solver import solve
from tests.scenes.export import tiny_results
from tests.unit.solver.observability.test_findings import (
    CAR,
    CURVED,
    SIGMA,
    STILL_SOUTH,
    STILL_WEST,
    STRAIGHT,
    VAN,
    Cam,
    poly,
    scene,
)

TOLD_SOUTH = Cam(STILL_SOUTH, tell_offset=True)
AT_THE_WATCHER = poly([0, 0, 0], [0, -6, 0])
WATCHER = Cam(
    poly([0, -200, 0]), offset_s=1.0, sees=(0,), tell_offset=True, sigma=replace(SIGMA, offset_s=0.1)
)  # fmt: skip
CARRIED = {
    "time-gauge": scene([Cam(CURVED), TOLD_SOUTH], [CAR, VAN]),
    "rotation-about-base-line": scene([Cam(STILL_WEST), TOLD_SOUTH], [CAR]),
    "coplanar-rays": scene([Cam(poly([-200, 0, 0])), Cam(poly([0, -200, 0]), tell_offset=True)], [CAR]),
    "offset-and-position": scene([Cam(CURVED), Cam(STILL_SOUTH, offset_s=2.0, tell_offset=True)], [CAR]),
    "offset-from-prior": scene([Cam(CURVED), WATCHER], [AT_THE_WATCHER]),
}
REFUSED = {
    "camera no less simple than the target": scene([Cam(STRAIGHT)], [CAR]),
    "one point": scene([Cam(STILL_WEST)], [CAR]),
    "parallel": scene([Cam(poly([-150, -80, 100], [8, 3, 0]))], [CAR]),
    "along the rays": scene([Cam(poly([-200, -75, 0]))], [poly([0, 0, 0], [8, 3, 0])]),
}


@pytest.mark.parametrize("kind", CARRIED)
def test_what_a_prior_carries_is_named_with_it(kind: str) -> None:
    solution = solve(CARRIED[kind], SolverSettings())
    results = tiny_results(solution=solution)
    written = [f for f in json.loads(solution_json(results))["findings"] if f["kind"] == kind]
    assert len(written) == 1
    assert written[0]["carried_by"]
    assert any(written[0]["words"] in r.words for r in remarks(results))
    assert all(np.isfinite(c.offset_sigma_s) for c in solution.clocks)


@pytest.mark.parametrize("problem", REFUSED.values(), ids=REFUSED)
def test_what_nothing_carries_is_refused(problem: Problem) -> None:
    with pytest.raises(GeometryError) as caught:
        solve(problem, SolverSettings())
    assert caught.value.exit_code == 5
    assert caught.value.advice


def test_a_target_that_cannot_be_known_does_not_take_the_others_down() -> None:
    """A still camera alone sees the van, a curving one alone the car: the van is left out, and it is said why."""
    solution = solve(scene([Cam(CURVED, sees=(0,)), replace(TOLD_SOUTH, sees=(1,))], [CAR, VAN]), SolverSettings())
    assert [motion.target for motion in solution.motions] == ["t0"]
    (left_out,) = (f for f in solution.findings if f.kind == "target-left-out")
    assert "t1" in left_out.words
    assert "cam1 stands still" in left_out.words


def test_the_neighbour_of_each_is_well_posed() -> None:
    """Three cameras, one of them curving, and two targets that turn: only the choice of the reference clock is left."""
    turning = [poly([0, 0, 0], [8, 3, 0], [-1.5, 1.0, 0]), poly([20, 10, 0], [-4, 7, 0], [1.0, 1.5, 0])]
    cams = [Cam(CURVED), TOLD_SOUTH, Cam(poly([150, 150, 40], [-3, 2, 1], [0.4, 0.9, 0.2]), tell_offset=True)]
    solution = solve(scene(cams, turning, order=2), SolverSettings())
    assert {f.kind for f in solution.findings} == {"time-gauge"}
