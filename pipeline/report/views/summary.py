"""The verdict in words: did it converge, what was found, how sure, and what to be careful about."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.records import Clock, Finding, Results, Solution
from pipeline.report.data import participants
from pipeline.report.text.markup import Html, joined, tag
from pipeline.report.text.words import SIGMA, counted, listed, plus_minus, rounded, whole

Grade = Literal["good", "care", "bad"]
LEAST_FIT, MOST_FIT = 0.7, 1.4
MARKS: dict[Grade, str] = {"good": "\u2713", "care": "!", "bad": "\u2717"}


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One line under the verdict: how serious, about what, in words."""

    grade: Grade
    subject: str
    words: str


def reference_clock(solution: Solution) -> Clock | None:
    """The clock that is held: common time is its time."""
    held = [c for c in solution.clocks if c.offset_s == 0 and c.offset_sigma_s == 0]
    return held[0] if held else None


def typical_sigma_m(results: Results) -> dict[str, float]:
    """Median over the well known part of each trajectory of the 3D position's sigma; NaN where unknown."""
    parts = {t.target: t.sigma_m[participants.well_known(results, t)] for t in results.trajectories}
    return {name: float(np.median(sigma)) for name, sigma in parts.items() if len(sigma)}


def verdict(results: Results) -> tuple[Grade, str]:
    """The verdict's grade and its one or two sentences."""
    solution = results.solution
    seen = f"{counted(len(results.trajectories), 'target')}, {counted(len(participants.cameras(results)), 'camera')}"
    if solution.status == "converged":
        grade, opening = _doubt(results)
        return grade, f"{opening}: {seen}; {_positions(results)}.{_offsets(solution)}"
    stopped = {"iteration-limit": f"after {counted(solution.iterations, 'iteration')}", "stalled": "without progress"}
    why = stopped.get(solution.status, "")
    return (
        "bad",
        f"Did not converge: stopped {why}. {seen}; the figures below are provisional and their sigmas too small.",
    )


def _doubt(results: Results) -> tuple[Grade, str]:
    """Grade and first words of a converged answer: it is not good where something contradicts its sigmas."""
    if not any(math.isfinite(s) for s in typical_sigma_m(results).values()):
        return "care", "Converged"
    if any(abs(r.after) > 3 * r.sigma > 0 for r in results.comparison):
        return "care", "Converged, but further from the truth than claimed"
    if reduced_chi_square(results.solution) > MOST_FIT:
        return "care", "Converged, but the residuals are larger than their sigmas promise"
    if any(r.grade == "care" for r in _about_offsets(results.solution)):
        return "care", "Converged, but other time offsets fit nearly as well"
    return "good", "Converged"


def _positions(results: Results) -> str:
    sigmas = typical_sigma_m(results)
    known = {t: s for t, s in sigmas.items() if math.isfinite(s)}
    if not known:
        return "positions found, but their uncertainty is unknown"
    best, worst = min(known.values()), max(known.values())
    if worst < 1.15 * best or len(known) == 1:
        return f"positions to {rounded(worst)}\u00a0m (1{SIGMA})"
    least_sure = max(known, key=known.__getitem__)
    return f"positions to {rounded(best)} to {rounded(worst)}\u00a0m (1{SIGMA}; {least_sure} is the least sure)"


def _offsets(solution: Solution) -> str:
    reference = reference_clock(solution)
    moved = [c for c in solution.clocks if c is not reference and c.offset_sigma_s != 0]
    if reference is None or not moved:
        return ""
    parts = [_start(c, reference.camera, i == 0) for i, c in enumerate(moved[:3])]
    more = f"; {len(moved) - 3} more in the timing table" if len(moved) > 3 else ""
    return f" {listed(parts)}{more}."


def _start(clock: Clock, reference: str, first: bool) -> str:
    word = "after" if clock.offset_s >= 0 else "before"
    size = plus_minus(abs(clock.offset_s), clock.offset_sigma_s, "s")
    return f"{clock.camera} started {size} {word} {reference}" if first else f"{clock.camera} {size} {word}"


def remarks(results: Results) -> list[Remark]:
    """Everything a reader must know before believing the figures, the most serious first."""
    found = [*_about_status(results.solution), *_about_fit(results.solution), *_about_offsets(results.solution)]
    found += [*_about_truth(results), *_about_outliers(results), *_about_gaps(results)]
    found += [Remark(grade="care", subject="", words=w) for w in results.warnings]
    found += [_from_finding(f) for f in results.solution.findings]
    order = {"bad": 0, "care": 1, "good": 2}
    return sorted(found, key=lambda r: order[r.grade])


def _about_status(solution: Solution) -> list[Remark]:
    if solution.status == "converged":
        return []
    return [Remark(grade="bad", subject="solver", words=solution.message)]


def reduced_chi_square(solution: Solution) -> float:
    """Chi-square per degree of freedom; NaN where nothing is left over."""
    return solution.chi_square / solution.degrees_of_freedom if solution.degrees_of_freedom > 0 else math.nan


def _about_fit(solution: Solution) -> list[Remark]:
    ratio = reduced_chi_square(solution)
    if not math.isfinite(ratio):
        return []
    tail = f"chi-square {rounded(solution.chi_square, 4)} with {whole(solution.degrees_of_freedom)} degrees of freedom"
    if LEAST_FIT <= ratio <= MOST_FIT:
        return [Remark(grade="good", subject="fit", words=f"Residuals are as large as their sigmas promise: {tail}.")]
    factor = rounded(math.sqrt(ratio))
    if ratio > 1:
        words = f"Residuals are {factor} times as large as their sigmas promise ({tail}): true errors may be, too."
    else:
        words = f"Residuals are only {factor} of what their sigmas promise ({tail}): the sigmas given are too cautious."
    return [Remark(grade="care", subject="fit", words=words)]


def _about_offsets(solution: Solution) -> list[Remark]:
    costs = sorted(c.cost for c in solution.offset_candidates)
    if len(costs) < 2:
        return []
    worse = 2 * (costs[1] - costs[0])
    words = f"The next best set of time offsets raises chi-square by {rounded(worse)}"
    if worse < 25:
        return [Remark(grade="care", subject="offsets", words=f"{words}: the offsets are not certain.")]
    return [Remark(grade="good", subject="offsets", words=f"{words}: the offsets are not in doubt.")]


def _about_truth(results: Results) -> list[Remark]:
    rows = [r for r in results.comparison if math.isfinite(r.after) and r.sigma > 0]
    if not rows:
        return []
    off = [r.what for r in rows if abs(r.after) > 3 * r.sigma]
    if not off:
        words = f"Compared with the truth, all {len(rows)} figures with a claimed sigma are within 3 of it."
        return [Remark(grade="good", subject="truth", words=words)]
    share = f"{len(off)} of {len(rows)} figures are off by more than 3 claimed sigmas"
    words = f"Compared with the truth, {share}: {listed(off[:4])}{' and others' if len(off) > 4 else ''}."
    return [Remark(grade="care", subject="truth", words=words)]


def _about_outliers(results: Results) -> list[Remark]:
    weight = results.solution.sightings.weight
    low = int(np.count_nonzero(weight < 0.5))
    if not low:
        return []
    share = f"{whole(low)} of {counted(len(weight), 'sighting')}"
    grade: Grade = "care" if low > 0.05 * len(weight) else "good"
    return [Remark(grade=grade, subject="outliers", words=f"{share} had less than half weight as outliers.")]


def _about_gaps(results: Results) -> list[Remark]:
    out = []
    for t in results.trajectories:
        known = participants.well_known(results, t)
        if len(known) < 2 or known.mean() > 0.98:
            continue
        lost = float((~known).mean() * (t.time_s[-1] - t.time_s[0]))
        whole_s = rounded(float(t.time_s[-1] - t.time_s[0]), 3)
        worst = rounded(float(np.nanmax(t.sigma_m, initial=0.0)))
        words = f"Too little was seen of it during {rounded(lost)} of {whole_s} s to know where it was"
        out.append(Remark(grade="care", subject=t.target, words=f"{words} (sigma up to {worst} m); drawn dotted."))
    return out


def _from_finding(finding: Finding) -> Remark:
    held = f" Decided instead by: {finding.carried_by}." if finding.carried_by else ""
    harmless = finding.kind == "time-gauge"
    grade: Grade = "good" if harmless else "care"
    return Remark(grade=grade, subject=finding.subject or finding.kind, words=f"{finding.words}{held}")


def header(results: Results) -> Html:
    """Title, verdict, key figures and remarks: the top of the page."""
    grade, words = verdict(results)
    mark = tag("span", MARKS[grade], class_="mark", aria_hidden="true")
    items = [_remark_item(r) for r in remarks(results)]
    return tag(
        "header",
        tag("p", "runningfix report", class_="kicker"),
        tag("h1", results.title),
        tag("p", mark, tag("span", words), class_=f"verdict {grade}"),
        _tiles(results),
        tag("ul", *items, class_="remarks", aria_label="Warnings and findings") if items else "",
    )


def _remark_item(remark: Remark) -> Html:
    spoken = {"good": "Fine: ", "care": "Warning: ", "bad": "Problem: "}[remark.grade]
    mark = joined(tag("span", MARKS[remark.grade], class_="mark", aria_hidden="true"), tag("span", spoken, class_="sr"))
    subject = joined(tag("b", remark.subject), " ") if remark.subject else Html("")
    return tag("li", mark, tag("span", subject, remark.words), class_=remark.grade)


def _tiles(results: Results) -> Html:
    solution = results.solution
    start, end = participants.time_span(results)
    facts = [
        (rounded(end - start, 3), "s", "of flight"),
        (whole(len(solution.sightings.frame)), "", "sightings used"),
        (whole(solution.iterations), "", f"iteration{'s' * (solution.iterations != 1)} of {solution.method}"),
    ]
    ratio = reduced_chi_square(solution)
    if math.isfinite(ratio):
        facts.append((rounded(ratio, 3), "", "chi-square per degree of freedom"))
    sigmas = [s for s in typical_sigma_m(results).values() if math.isfinite(s)]
    if sigmas:
        facts.insert(0, (rounded(float(np.median(sigmas))), "m", f"typical position sigma (1{SIGMA})"))
    tiles = [tag("div", tag("dd", value, tag("small", f" {unit}")), tag("dt", words)) for value, unit, words in facts]
    return tag("dl", *tiles, class_="tiles")
