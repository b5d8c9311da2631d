"""A verdict says what is wrong, names who did it first, and is silent where nothing is."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from calibration.foundation.errors import GeometryError
from pipeline.records import Finding, Problem, Reason, Solution, SolverSettings, TargetInput
from pipeline.solver import solve
from pipeline.synthetic.scenes import paper_scene
from pipeline.synthetic.simulate import simulate
from tests.scenes import mistaken
from tests.scenes.solver import looped_flight


def solved(problem: Problem) -> Solution:
    return solve(problem, SolverSettings())


@pytest.mark.parametrize("seed", range(4))
def test_a_flight_whose_claims_are_true_is_good(seed: int) -> None:
    verdict = solved(mistaken.right_flight(seed)).verdict
    assert verdict.grade == "good", verdict
    assert not verdict.reasons


def test_an_answer_without_sigmas_is_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["pipeline.solver.methods.map_estimation"], "factorise", lambda _: None)
    verdict = solved(mistaken.right_flight(0)).verdict
    assert verdict.grade == "bad"
    assert verdict.reasons[0].kind == "undetermined"
    assert "no sigma is known" in verdict.reasons[0].words


def test_chi_square_is_what_was_expected() -> None:
    z = []
    for seed in range(8):
        found = solved(mistaken.right_flight(seed))
        z.append((found.chi_square - found.expected_chi_square) / np.sqrt(2 * found.expected_chi_square))
    assert abs(np.mean(z)) < 3.5 / np.sqrt(8)
    assert 0.4 < np.std(z) < 1.7


@pytest.mark.parametrize(
    ("problem", "kind", "subject", "said"),
    [
        (mistaken.turned(mistaken.right_flight(1), "uav2", np.array([0, 12, 0])), "suspect-attitude", "uav2", "turned"),
        (mistaken.exchanged(mistaken.right_flight(1), "uav2", 0, 2), "suspect-exchange", "uav2", "target1 and target3"),
        (mistaken.exchanged(mistaken.right_flight(1), "uav1", 1, 2, since=26), "suspect-exchange", "uav1", "frame 2"),
        (mistaken.sliding(mistaken.right_flight(1), "uav1", 3, since=25), "suspect-without", "target4", "contradicts"),
        (mistaken.shifted(mistaken.right_flight(1), "uav1", np.array([0, 0, 40.0])), "suspect-position", "uav1", "40"),
        (
            mistaken.shifted(mistaken.right_flight(1), "uav2", np.array([9.0, 9.0, 0]), since=25),
            "suspect-position-step", "uav2", "frame 2",
        ),
    ],
    ids=("mount", "exchange", "exchange half way", "slide", "height", "jump"),
)  # fmt: skip
def test_a_mistake_is_bad_and_its_culprit_is_named_first(problem: Problem, kind: str, subject: str, said: str) -> None:
    verdict = solved(problem).verdict
    assert verdict.grade == "bad", verdict
    named = [r for r in verdict.reasons[:2] if r.kind.startswith(kind) and subject in r.subject]
    assert named, verdict.reasons
    assert said in named[0].words
    assert named[0].advice
    assert named[0].figure > 50


def test_a_jump_that_free_motions_follow_is_named_with_its_camera_and_moment() -> None:
    right = _free(mistaken.right_flight(1))
    assert solved(right).verdict.grade == "good"
    jumping = _free(mistaken.shifted(right, "uav2", np.array([9.0, 9.0, 0.0]), since=25))
    verdict = solved(jumping).verdict
    assert verdict.grade != "good"
    first = verdict.reasons[0]
    assert first.kind == "suspect-position-step"
    assert first.subject == "uav2"
    assert "frame 25" in first.words


def test_a_single_target_that_bends_is_no_jump_of_a_camera() -> None:
    assert not [r for r in solved(looped_flight(0.0, seconds=30.0)[0]).verdict.reasons if "step" in r.kind]


def _free(problem: Problem) -> Problem:
    return replace(problem, targets=tuple(TargetInput(target=t.target, motion="spline") for t in problem.targets))


def test_heights_of_two_datums_contradict_each_other() -> None:
    verdict = solved(mistaken.shifted(mistaken.right_flight(1), "uav1", np.array([0.0, 0.0, 8.0]))).verdict
    named = [r for r in verdict.reasons if r.kind == "prior-heights"]
    assert verdict.grade != "good"
    assert len(named) == 1
    assert "uav2 4.31 m higher against uav1" in named[0].words
    assert "datum" in named[0].advice


def test_a_bad_end_of_a_track_without_which_the_answer_stands_is_care() -> None:
    slid = mistaken.sliding(mistaken.right_flight(1, targets=6), "uav1", 3, since=44, px_per_frame=6.0)
    verdict = solved(slid).verdict
    assert verdict.grade == "care"
    assert verdict.reasons[0].kind == "suspect-without-part"
    assert "of its sigmas: it stands" in verdict.reasons[0].words
    worse = mistaken.sliding(mistaken.right_flight(1, targets=6), "uav1", 3, since=25, px_per_frame=6.0)
    assert solved(worse).verdict.grade == "bad"


def test_a_motion_that_was_given_too_simple_is_named() -> None:
    scene = paper_scene(order=2, targets=3, given_offset_s=0.5)
    problem = simulate(scene, noise=mistaken.INSTRUMENTS, seed=1)[0]
    given = tuple(TargetInput(target=t.target, order=2 if t.target == "target2" else 1) for t in problem.targets)
    verdict = solved(replace(problem, targets=given)).verdict
    assert verdict.grade != "good"
    named = [r for r in verdict.reasons[:2] if r.kind == "suspect-motion"]
    assert named, verdict.reasons
    assert "target1" in named[0].subject
    assert "order" in named[0].advice


def test_a_polynomial_that_was_asked_for_and_does_not_fit_is_not_forced() -> None:
    problem, path = looped_flight(0.0, seconds=30.0)
    asked = replace(problem, targets=(TargetInput(target="drone", motion="polynomial"),))
    found = solved(asked)
    motion = found.motion("drone")
    time = np.linspace(motion.start_s + 1, motion.end_s - 1, 50)
    assert motion.kind == "spline"
    assert np.abs(motion.position_enu_m(time) - path(time)).max() < 1.0
    assert [r.grade for r in found.verdict.reasons if r.kind == "motion-richer"] == ["good"]


def test_priors_ten_times_too_small_are_named() -> None:
    noise = replace(mistaken.INSTRUMENTS, attitude_bias_rad=10 * mistaken.INSTRUMENTS.attitude_bias_rad)
    problem = mistaken.right_flight(3, noise=noise)
    for camera in problem.cameras:
        small = replace(camera.sigma, attitude_bias_rad=camera.sigma.attitude_bias_rad / 10)
        problem = mistaken.with_camera(problem, camera.camera, sigma=small)
    verdict = solved(problem).verdict
    assert verdict.grade != "good"
    assert any("attitude" in r.kind and "its prior says 0.3" in r.words for r in verdict.reasons[:2]), verdict.reasons


@pytest.mark.parametrize("wrong", [True, False])
def test_what_a_solution_that_does_not_fit_says_of_geometry_refuses_nothing(
    wrong: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def undetermined(*_: object, clocks: object = (), **__: object) -> tuple[Finding, ...]:
        if clocks:
            raise GeometryError(where="target target1", seen="s", expected="e", advice="a")
        return ()

    monkeypatch.setattr(sys.modules["pipeline.solver.solve"], "find_degeneracies", undetermined)
    flight = mistaken.right_flight(1, targets=1)
    problem = mistaken.turned(flight, "uav2", np.array([0, 12, 0])) if wrong else flight
    if not wrong:
        with pytest.raises(GeometryError):
            solved(problem)
        return
    verdict = solved(problem).verdict
    assert verdict.grade == "bad"
    assert verdict.reasons[-1].kind == "undetermined"
    assert any("uav2" in r.subject for r in verdict.reasons[:2])


def test_nothing_is_applied() -> None:
    problem = mistaken.exchanged(mistaken.right_flight(1), "uav2", 0, 2)
    found = solved(problem)
    assert {m.target for m in found.motions} == {t.target for t in problem.targets}
    assert len(found.sightings.frame) == sum(len(c.rays.frame) for c in problem.cameras)


def test_a_mistake_is_not_hidden_in_pose_errors_that_last() -> None:
    found = solved(mistaken.exchanged(mistaken.right_flight(1), "uav2", 0, 2))
    assert not [f for f in found.findings if f.kind == "wandering-poses"]


def test_errors_that_are_alike_are_said_and_start_no_search_for_a_culprit(monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = sys.modules["pipeline.solver.judgement.verdict"]
    alike = Reason(
        kind="pose-errors-alike", subject="uav1", words="w", advice="a", grade="care", figure=1.0, measure="m"
    )
    monkeypatch.setattr(verdict, "_of_sequences", lambda *_: [alike])
    monkeypatch.setattr(verdict, "search_culprits", None)
    assert solved(mistaken.right_flight(0)).verdict.reasons == (alike,)


def test_one_sigma_is_the_larger_of_plain_and_robust() -> None:
    found = solved(mistaken.right_flight(2))
    assert found.shared_covariance is not None
    assert found.shared_covariance_robust is not None
    at = found.shared_names.index("uav2.offset_s")
    larger = max(found.shared_covariance[at, at], found.shared_covariance_robust[at, at])
    assert found.clock("uav2").offset_sigma_s == pytest.approx(np.sqrt(larger))


def test_methods_without_sigmas_are_judged_by_convergence() -> None:
    verdict = solve(mistaken.right_flight(1), SolverSettings(method="intersection")).verdict
    assert verdict.grade == "good"
