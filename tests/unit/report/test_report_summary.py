from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.records import Finding, OffsetCandidate, Results
from pipeline.report.views.summary import header, remarks, typical_sigma_m, verdict
from tests.scenes.report import fake_results


def solved(results: Results, **changes) -> Results:
    return dataclasses.replace(results, solution=dataclasses.replace(results.solution, **changes))


def unjudged(results: Results) -> Results:
    return dataclasses.replace(results, truth=None, comparison=())


def said(results: Results) -> str:
    return " ".join(r.words for r in remarks(results))


def test_the_verdict_says_what_was_found_and_how_sure():
    grade, words = verdict(unjudged(fake_results()))
    assert grade == "good"
    assert words.startswith("Converged: 4 targets, 2 cameras; positions to 0.")
    assert "uav2 started 1.600 \u00b1 0.004\u00a0s after uav1." in words


@pytest.mark.parametrize(
    ("change", "but"),
    [
        (lambda r: r, "further from the truth than claimed"),
        (lambda r: solved(unjudged(r), chi_square=8000.0), "the residuals are larger than their sigmas promise"),
        (
            lambda r: solved(
                unjudged(r), offset_candidates=tuple(OffsetCandidate(offset_s={}, cost=c) for c in (1, 3))
            ),
            "other time offsets fit nearly as well",
        ),
    ],
)
def test_a_converged_answer_that_is_contradicted_is_not_called_good(change, but):
    grade, words = verdict(change(fake_results()))
    assert grade == "care"
    assert words.startswith(f"Converged, but {but}: 4 targets")


def test_a_camera_that_started_earlier_is_said_so():
    results = fake_results()
    first, second = results.solution.clocks
    _, words = verdict(solved(results, clocks=(first, dataclasses.replace(second, offset_s=-3.0))))
    assert "uav2 started 3.000 \u00b1 0.004\u00a0s before uav1." in words


def test_many_cameras_stay_one_sentence():
    _, words = verdict(fake_results(cameras=6, seconds=4))
    assert words.endswith("2 more in the timing table.")


@pytest.mark.parametrize("status", ["iteration-limit", "stalled"])
def test_no_convergence_is_the_first_thing_said(status):
    results = solved(fake_results(), status=status, message="the cost still falls")
    grade, words = verdict(results)
    assert grade == "bad"
    assert words.startswith("Did not converge")
    assert remarks(results)[0].words == "the cost still falls"


def test_unknown_uncertainty_is_said():
    results = fake_results()
    blind = tuple(dataclasses.replace(t, covariance=np.full_like(t.covariance, np.nan)) for t in results.trajectories)
    _, words = verdict(dataclasses.replace(results, trajectories=blind))
    assert "uncertainty is unknown" in words


def test_typical_sigma_is_the_median():
    results = fake_results()
    track = results.trajectories[0]
    assert typical_sigma_m(results)[track.target] == pytest.approx(np.median(track.sigma_m))


@pytest.mark.parametrize(
    ("chi_square", "grade", "words"),
    [
        (4000.0, "good", "as large as their sigmas promise"),
        (16000.0, "care", "Residuals are 2.0 times as large"),
        (1000.0, "care", "only 0.50 of what"),
    ],
)
def test_the_fit_in_words(chi_square, grade, words):
    found = remarks(solved(fake_results(), chi_square=chi_square, degrees_of_freedom=4000))
    fit = next(r for r in found if r.subject == "fit")
    assert fit.grade == grade
    assert words in fit.words


def test_two_sets_of_offsets_that_fit_alike_are_a_warning():
    pair = tuple(OffsetCandidate(offset_s={"uav2": o}, cost=c) for o, c in ((1.6, 100.0), (4.6, 104.0)))
    found = remarks(solved(fake_results(), offset_candidates=pair))
    offsets = next(r for r in found if r.subject == "offsets")
    assert offsets.grade == "care"
    assert "not certain" in offsets.words


def test_truth_out_of_three_sigmas_is_named():
    assert "1 of 8 figures are off by more than 3 claimed sigmas: orientation of uav2." in said(fake_results())


def test_gaps_are_said():
    results = fake_results()
    track = results.trajectories[0]
    factor = np.where(track.time_s > 15, 400.0, 1.0)
    wide = dataclasses.replace(track, covariance=track.covariance * factor[:, None, None])
    words = said(dataclasses.replace(results, trajectories=(wide, *results.trajectories[1:])))
    assert "Too little was seen of it during 5.0 of 20.0 s" in words


def test_warnings_and_findings_come_through_and_are_escaped():
    nasty = Finding(kind="coplanar-rays", subject="<i>", words="Rays & planes.", carried_by="the prior")
    results = dataclasses.replace(solved(fake_results(), findings=(nasty,)), warnings=("<script>x</script>",))
    page = header(results)
    assert "&lt;i&gt;" in page
    assert "Rays &amp; planes. Decided instead by: the prior." in page
    assert "<script>" not in page


def test_no_degrees_of_freedom_is_no_fit():
    results = solved(fake_results(), degrees_of_freedom=0)
    assert all(r.subject != "fit" for r in remarks(results))
    assert "chi-square per degree" not in header(results)
