"""From the tests to a verdict: what speaks against the answer, the likeliest culprit first.

prior tests     what the adjustment took from each prior
misfit          residuals against their own redundancy: of all, of cameras, targets, tracks
pose sequences  steps, drift, likeness of frames' own errors
shutters        whether rows ask for a readout that was not given
culprits        only where one of these is doubtful: the change that would restore the fit
the rest        convergence, ambiguous offsets, outliers, depths whose sigma is not symmetric
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import GeometryError
from pipeline.records import DepthRange, Finding, Grade, Landmark, Problem, Reason, Solution, Verdict, worst
from pipeline.solver.adjustment.levenberg_marquardt import Fit
from pipeline.solver.adjustment.model import residuals_of
from pipeline.solver.judgement.against_known import known_reasons
from pipeline.solver.judgement.changes import FREED
from pipeline.solver.judgement.common_steps import common_steps
from pipeline.solver.judgement.corrections import corrections
from pipeline.solver.judgement.culprits import RESTORED, Clocks, Explained, Searched, search_culprits
from pipeline.solver.judgement.depth import depth_ranges
from pipeline.solver.judgement.influence import moved_sigmas
from pipeline.solver.judgement.misfit import Misfit, Misfits, misfits
from pipeline.solver.judgement.pose_sequences import Sequence, pose_sequences
from pipeline.solver.judgement.prior_tests import HeightTest, PriorTest, height_tests, prior_tests
from pipeline.solver.judgement.rolling_shutter import shutter_reasons, shutter_tests
from pipeline.solver.judgement.settings import SETTINGS, JudgementSettings
from pipeline.solver.judgement.words import (
    Told,
    change_words,
    correction_words,
    height_words,
    misfit_words,
    mount_words,
    number,
    readouts_words,
    sequence_words,
)
from pipeline.solver.methods.results import Outcome
from pipeline.solver.observation.clocks import READOUT
from pipeline.solver.uncertainty.covariance import Inverse

NAMED = 3
"""Suspects that are named."""
FURTHER = 6
"""Doubts that are told after the suspects, the gravest kinds first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tests:
    """What was tested, each the most unlikely first."""

    priors: tuple[PriorTest, ...]
    heights: tuple[HeightTest, ...]
    misfits: Misfits
    sequences: tuple[Sequence, ...]


def judged(problem: Problem, found: Outcome, solution: Solution, settings: JudgementSettings = SETTINGS) -> Solution:
    """The solution with its verdict, the chi-square it was to be expected to have, and the depths that are unsure."""
    reasons = [*_convergence(solution), *_offsets(solution), *_spoken(solution.findings)]
    expected, depths, taken = solution.expected_chi_square, solution.depths, solution.corrections
    if solution.method == "map" and found.plain is not None:
        tests = tested(found)
        expected = tests.misfits.whole.redundancy
        taken = corrections(found, tests.priors, prior_grade(tests.priors, settings), settings)
        depths = depth_ranges(found.model, found.state, solution, settings.depth_share)
        doubts = [
            *_of_priors(problem, tests.priors, settings),
            *_of_heights(tests.heights, settings),
            *_of_sequences(tests.sequences, settings),
            *_of_misfits(tests.misfits, settings),
        ]
        if any(reason.kind != "pose-errors-alike" for reason in doubts):  # of those no single change is the cause
            doubts = _with_suspects(problem, found, solution, tests, doubts, settings)
        ground = 0.0 if problem.ground is None else problem.ground.sigma_m
        shutters = shutter_reasons(problem, shutter_tests(problem, found, solution), settings)
        against = known_reasons(solution.landmarks, solution.ground, ground, settings)
        if any(reason.kind == "rolling-shutter" for reason in doubts):
            shutters = []
        reasons = [*against, *doubts, *shutters, *reasons, *_depths(depths)]
    elif solution.method == "map":
        reasons = [_no_sigmas(), *reasons]
    reasons.sort(key=lambda reason: reason.grade == "good")  # what speaks against the answer comes first
    verdict = Verdict(grade=worst(tuple(r.grade for r in reasons)), reasons=tuple(reasons))
    return replace(solution, verdict=verdict, expected_chi_square=expected, depths=depths, corrections=taken)


def tested(found: Outcome) -> Tests:
    """All tests that need no further adjustment."""
    assert found.plain is not None
    model, state = found.model, found.state
    residual = residuals_of(model.frames, slice(None), model, state)
    square = (residual**2).sum(axis=-1) * model.frames.seen
    steps = common_steps(model, state, found.plain.factor) if isinstance(found.plain, Inverse) else ()
    return Tests(
        priors=prior_tests(model, state, found.plain, found.robust),
        heights=height_tests(model, state, found.plain, found.robust),
        misfits=misfits(model, state, found.plain, square),
        sequences=_sequences(pose_sequences(model, state), steps),
    )


def _sequences(own: tuple[Sequence, ...], common: tuple[Sequence, ...]) -> tuple[Sequence, ...]:
    """What frames' own errors say and what all motions say together, of each camera's steps the more unlikely."""
    best = {s.camera: s for s in sorted((*common, *(s for s in own if s.kind == "step")), key=lambda s: -s.log10_p)}
    others = (s for s in own if s.kind != "step")
    return tuple(sorted((*best.values(), *others), key=lambda s: s.log10_p))


def _graded(value: float, care: float, bad: float) -> Grade:
    """The grade of a figure that is the worse the lower it is."""
    return "bad" if value < bad else "care" if value < care else "good"


def prior_grade(tests: Collection[PriorTest], settings: JudgementSettings) -> Callable[[PriorTest], Grade]:
    """What the correction of one block says, of so many that were looked at."""
    many = float(np.log10(max(len(tests), 1)))
    return lambda t: _graded(t.log10_p + many, settings.prior_care, settings.prior_bad)


def _of_priors(problem: Problem, tests: Iterable[PriorTest], settings: JudgementSettings) -> list[Reason]:
    tests, rates = tuple(tests), {c.camera: c.frame_rate for c in problem.cameras}
    grade_of, out = prior_grade(tests, settings), []
    for t in tests:
        grade = grade_of(t)
        if grade == "good":
            continue
        told = correction_words(t.camera, t.what, t.correction, t.sigma, rates[t.camera])
        out.append(
            Reason(
                kind=f"prior-{t.what}", subject=t.camera, words=told.words, advice=told.advice, grade=grade,
                figure=t.statistic, measure=f"chi-square with {t.freedom} degrees of freedom",
            )
        )  # fmt: skip
    return out


def _of_heights(tests: Collection[HeightTest], settings: JudgementSettings) -> list[Reason]:
    many = float(np.log10(max(len(tests), 1)))
    out = []
    for t in tests:
        grade = _graded(t.log10_p + many, settings.heights_care, settings.prior_bad)
        if grade == "good":
            continue
        told = height_words(t)
        out.append(
            Reason(
                kind="prior-heights", subject=", ".join((t.camera, *t.others)) if len(tests) == 1 else t.camera,
                words=told.words, advice=told.advice, grade=grade, figure=t.z, measure="normal deviate",
            )
        )  # fmt: skip
    return out


def _of_sequences(sequences: Iterable[Sequence], settings: JudgementSettings) -> list[Reason]:
    sequences = tuple(sequences)
    many = float(np.log10(max(len(sequences), 1)))
    out = []
    for one in sequences:
        grade = _graded(one.log10_p + many, settings.sequence_care, settings.sequence_bad)
        if grade == "bad" and one.kind == "alike":
            grade = "care"  # errors that last make sigmas doubtful; they do not make the answer another one
        if grade == "good" or (one.kind == "alike" and one.correlation < settings.alike):
            continue
        told = sequence_words(one)
        freedom = 1 if one.kind == "alike" else 6
        out.append(
            Reason(
                kind={"step": "pose-step", "drift": "pose-drift", "alike": "pose-errors-alike"}[one.kind],
                subject=one.camera, words=told.words, advice=told.advice, grade=grade, figure=one.statistic,
                measure=f"chi-square with {freedom} degrees of freedom",
            )
        )  # fmt: skip
    return out


def _of_misfits(found: Misfits, settings: JudgementSettings) -> list[Reason]:
    """Of everything; and of the parts that stand out beyond what everything does."""
    out = []
    groups: tuple[tuple[str, tuple[Misfit, ...]], ...] = (
        ("unit-weight", (found.whole,)),
        ("misfit-track", found.tracks),
        ("misfit-target", found.targets),
        ("misfit-camera", found.cameras),
    )
    for kind, members in groups:
        spread = max(1.0, found.whole.factor if kind != "unit-weight" else 1.0)
        allowed = float(np.sqrt(2 * np.log(max(len(members), 1))))
        for m in members[:2]:
            z = m.z - allowed
            if z < settings.fit_care or m.factor < settings.factor_care * spread:
                continue
            bad = z > settings.fit_bad and m.factor > settings.factor_bad * spread
            told = misfit_words(m)
            subject = {"track": f"{m.camera}: {m.target}", "camera": m.camera, "target": m.target}.get(m.scope, "")
            out.append(
                Reason(
                    kind=kind, subject=subject, words=told.words, advice=told.advice, grade="bad" if bad else "care",
                    figure=m.z, measure="normal deviate of the sum of squares from its redundancy",
                )
            )  # fmt: skip
    return out


# --- culprits ------------------------------------------------------------------------------------------------------


def _with_suspects(
    problem: Problem, found: Outcome, solution: Solution, tests: Tests, doubts: list[Reason],
    settings: JudgementSettings,
) -> list[Reason]:  # fmt: skip
    """The likeliest culprits, then the doubts; what a culprit already says is not said twice."""
    searched = search_culprits(problem, found.model, found.state, tests.misfits, tests.sequences, _other_clocks(found))
    best = _distinct(searched)
    moved = _moved(searched.base, best[0], solution) if best else float("inf")
    stands = moved <= settings.unmoved_sigmas
    if stands:
        doubts = [_lightened(r) for r in doubts]
    grade = worst(tuple(r.grade for r in doubts if not (stands and r.kind.startswith("pose-"))))
    jumping = {e.change.camera for e in best if e.change.kind == "step"}
    suspects = [_suspect(problem, e, tests, grade) for e in best]
    if stands:
        words = f"{suspects[0].words}. Without it the answer moves by {number(moved)} of its sigmas: it stands"
        suspects[0] = replace(suspects[0], words=words)
    named: list[tuple[float, Reason]] = [(e.net, reason) for e, reason in zip(best, suspects, strict=True)]
    named += [(r.figure, r) for r in doubts if r.kind.startswith("pose-") and r.subject not in jumping]
    first = [reason for _, reason in sorted(named, key=lambda pair: -pair[0])[:NAMED]]
    said = {(r.kind.removeprefix("suspect-"), r.subject) for r in first}
    rest = [
        r
        for r in doubts
        if r not in first
        and (r.kind.removeprefix("prior-"), r.subject) not in said
        and not (r.kind.startswith("pose-") and (r.subject in jumping or (best and best[0].z < RESTORED)))
    ]
    return [*first, *rest[:FURTHER], *_cut(searched)]


def _moved(base: Fit, best: Explained, solution: Solution) -> float:
    """How far the answer moves, in its own sigmas, where leaving out a track, or a part of one, restores the fit."""
    track = best.change.kind in ("without-part", "without-track")
    return moved_sigmas(base, best.fit, solution) if track and best.z < RESTORED else float("inf")


def _lightened(reason: Reason) -> Reason:
    """A misfit that a track explains which the answer does not rest on."""
    fits = reason.kind == "unit-weight" or reason.kind.startswith("misfit-")
    return replace(reason, grade="care") if fits and reason.grade == "bad" else reason


def _cut(searched: Searched) -> list[Reason]:
    if not searched.cut:
        return []
    words = f"{searched.tried} changes were tried for a culprit, and there are more"
    advice = "leave out cameras or targets yourself to narrow it down"
    return [Reason(kind="search-cut", subject="", words=words, advice=advice, grade="good")]


def _other_clocks(found: Outcome) -> list[Clocks]:
    """Clocks of the next best candidates of the offset search."""
    frames, out = found.model.frames, []
    for candidate in found.candidates[1:3]:
        offset = np.array([candidate.offset_s.get(name, 0.0) for name in frames.cameras])
        rate = [candidate.frame_rate.get(n, r) for n, r in zip(frames.cameras, frames.nominal_rate, strict=True)]
        out.append((offset, frames.nominal_rate / np.array(rate) - 1))
    return out


def _distinct(searched: Searched) -> list[Explained]:
    """The best changes, of those that accuse the same the best only."""
    out: list[Explained] = []
    for one in searched.found:
        if len(out) == NAMED:
            break
        if all(one.change.names != other.change.names for other in out):
            out.append(one)
    return out


def _suspect(problem: Problem, one: Explained, tests: Tests, grade: Grade) -> Reason:
    change, camera = one.change, next((c for c in problem.cameras if c.camera == one.change.camera), None)
    if change.kind == "readout":
        told, kind, subject = _readout_told(one), "rolling-shutter", ""
    elif change.kind == "step":
        told = _step_told(one)
        kind, subject = f"suspect-{change.what}-step", change.camera
    elif change.kind == "free" and camera is not None:
        frames, state = one.fit.model.frames, one.fit.state
        c = frames.cameras.index(camera.camera)
        columns = FREED[change.what][0]
        correction = state.camera[c, columns] - one.fit.model.priors.camera_mean[c, columns]
        sigma = _prior_sigma(tests, camera.camera, change.what, len(columns))
        told = correction_words(camera.camera, change.what, correction, sigma, camera.frame_rate)
        if change.what == "attitude" and camera.mount_ypr_rad is not None:
            fits = mount_words(camera.mount_ypr_rad, correction)
            told = replace(told, words=f"{told.words}; {fits}")
        kind, subject = f"suspect-{change.what}", camera.camera
    else:
        told = change_words(change)
        kind, subject = f"suspect-{change.kind}", ": ".join(filter(None, (change.camera, " and ".join(change.targets))))
    ends = "the rest then fits" if one.z < RESTORED else "more is wrong than that"
    return Reason(
        kind=kind, subject=subject, grade=grade, advice=told.advice, figure=one.gain,
        words=f"{told.words}. That would take {number(one.gain)} off chi-square, and {ends}",
        measure="fall of chi-square beyond its expectation",
    )  # fmt: skip


def _readout_told(one: Explained) -> Told:
    """The words of readouts that nobody gave."""
    free, found = one.fit.model.priors.camera_free[:, READOUT], one.fit.state.camera[:, READOUT]
    names = one.fit.model.frames.cameras
    return readouts_words({name: float(found[c]) for c, name in enumerate(names) if free[c]})


def _step_told(one: Explained) -> Told:
    """The words of a step with its size: the part after less the part before."""
    told, what, state = change_words(one.change), one.change.what, one.fit.state
    c = one.fit.model.frames.cameras.index(one.change.camera)
    columns = FREED[what][0]
    size = float(np.linalg.norm(state.camera[c + 1, columns] - state.camera[c, columns]))
    said = {"attitude": f"{number(np.degrees(size))} degrees", "position": f"{number(size)} m"}
    return replace(told, words=f"{told.words}, by {said.get(what, f'{number(size)} s')}")


def _prior_sigma(tests: Tests, camera: str, what: str, size: int) -> Floats:
    known = next((t.sigma for t in tests.priors if t.camera == camera and t.what == what), None)
    return np.zeros(size) if known is None else known


# --- the rest ------------------------------------------------------------------------------------------------------


def _convergence(solution: Solution) -> list[Reason]:
    if solution.status == "converged":
        return []
    return [
        Reason(
            kind="not-converged", subject="", words=f"the adjustment did not converge: {solution.message}", grade="bad",
            advice="look at the other reasons first; else give better first values or more iterations",
            figure=float(solution.iterations), measure="iterations",
        )
    ]  # fmt: skip


def _no_sigmas() -> Reason:
    return Reason(
        kind="undetermined", subject="", grade="bad",
        words="the sightings leave something open: the normal equations have no inverse, so that no sigma is known and "
        "no test could be made",
        advice="use cameras that stand farther apart, smaller sigmas where they are true, or on_ground with "
        "[ground]",
    )  # fmt: skip


def _offsets(solution: Solution) -> list[Reason]:
    return [
        Reason(
            kind=f.kind, subject=f.subject, words=f.words, grade="care",
            advice="give offset_s with sigma.offset_s, or track a target that turns or stops",
        )
        for f in solution.findings
        if f.kind == "ambiguous-offset"
    ]  # fmt: skip


SPOKEN = {
    "left-out": "look at those sightings",
    "target-left-out": "give it what the words ask for, or leave it out of the flight file",
    "many-outliers": "look at the tracks",
    "motions-or-poses": "compare the log with another receiver's, give larger sigmas if it may be so wrong, or "
    'motion = "polynomial" with an order if the targets do go simply',
    "low-weights": 'look at the tracks of that camera; with that many outliers use robust = "cauchy"',
}
"""Findings that lower the verdict to "care", with their advice."""
REMARKED = {
    "seen-by-one": "two cameras that see it then would carry on; or on_ground with [ground], where it drives",
    "motion-richer": 'write motion = "auto" or "spline" for it',
}
"""Findings that are told beside it, with their advice."""


def _spoken(findings: Iterable[Finding]) -> list[Reason]:
    grades: dict[str, tuple[Grade, str]] = {kind: ("care", advice) for kind, advice in SPOKEN.items()}
    grades |= {kind: ("good", advice) for kind, advice in REMARKED.items()}
    grades["uneven-ground"] = (
        "bad",
        "use a second camera, or level ground: this is a known limit (docs/flight-file.md)",
    )
    grades["ground-gap"] = ("care", "take a terrain model without voids there, one that covers the whole way")
    return [
        Reason(kind=f.kind, subject=f.subject, words=f.words, grade=grades[f.kind][0], advice=grades[f.kind][1])
        for f in findings
        if f.kind in grades
    ]


def with_findings(solution: Solution, findings: tuple[Finding, ...]) -> Solution:
    """The solution with findings from before it was solved, and with the verdict that they leave."""
    reasons = (*solution.verdict.reasons, *_spoken(findings))
    verdict = Verdict(grade=worst(tuple(r.grade for r in reasons)), reasons=reasons)
    return replace(solution, findings=(*findings, *solution.findings), verdict=verdict)


def with_landmarks(solution: Solution, found: tuple[Landmark, ...]) -> Solution:
    """The solution with check points, and with the verdict that they leave."""
    reasons = (*solution.verdict.reasons, *known_reasons(found, (), 0.0, SETTINGS))
    verdict = Verdict(grade=worst(tuple(r.grade for r in reasons)), reasons=reasons)
    return replace(solution, landmarks=(*solution.landmarks, *found), verdict=verdict)


def with_refusal(solution: Solution, error: GeometryError) -> Solution:
    """The solution with what its geometry seems to leave open, last among the reasons."""
    reason = Reason(
        kind="undetermined", subject=error.where.removeprefix("target ").removeprefix("camera "), grade="bad",
        words=f"as solved, {error.where} is not determined: {error.seen}; that may be false where more contradicts it",
        advice=error.advice,
    )  # fmt: skip
    verdict = Verdict(grade="bad", reasons=(*solution.verdict.reasons, reason))
    return replace(solution, verdict=verdict)


def _depths(depths: Iterable[DepthRange]) -> list[Reason]:
    """Said, and no fault: the interval is what holds."""
    return [
        Reason(
            kind="depth", subject=d.target, grade="good",
            words=f"{d.target} is {number(d.depth_m)} m from {d.camera}, in 95 of 100 flights between "
            f"{number(d.within_95_m[0])} and {number(d.within_95_m[1])} m: its sigma of {number(d.sigma_m)} m is not "
            "symmetric",
            advice="use the interval; a longer base line between the cameras makes it shorter",
            figure=d.sigma_m / d.depth_m, measure="sigma over depth",
        )
        for d in depths
    ]  # fmt: skip
