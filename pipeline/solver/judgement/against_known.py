"""Does the answer contradict what was known: surveyed landmarks, check points, the ground?

What an adjustment takes from a claim has a known variance (`prior_tests`); a check point's error has that of the survey
and of the answer together. Both are chi-square if all claims are true.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.special import chdtrc

from pipeline.records import Grade, GroundFit, Landmark, Reason
from pipeline.solver.judgement.settings import JudgementSettings

FLOOR = 0.02
"""Least share of a claim's variance that a correction is granted, as in `prior_tests`."""


def known_reasons(
    landmarks: Iterable[Landmark], ground: Iterable[GroundFit], ground_sigma_m: float, settings: JudgementSettings
) -> list[Reason]:
    """What speaks against the answer, or against what was said of points and ground."""
    landmarks, ground = tuple(landmarks), tuple(ground)
    many = float(np.log10(max(len(landmarks) + len(ground), 1)))
    out = []
    for one in landmarks:
        grade = _grade(one.statistic, 3, many, settings)
        if grade != "good" and one.off_m is not None:
            out.append(_of_landmark(one, grade))
    for fit in ground:
        spent = max(ground_sigma_m**2 - fit.sigma_m**2, FLOOR * ground_sigma_m**2)
        statistic = fit.off_m**2 / spent if spent > 0 else float("nan")
        grade = _grade(statistic, 1, many, settings)
        if grade != "good":
            out.append(_of_ground(fit, ground_sigma_m, statistic, grade))
    return out


def _grade(statistic: float, freedom: int, many: float, settings: JudgementSettings) -> Grade:
    if not np.isfinite(statistic):
        return "good"
    log10_p = float(np.log10(max(float(chdtrc(freedom, statistic)), 1e-300))) + many
    return "bad" if log10_p < settings.prior_bad else "care" if log10_p < settings.prior_care else "good"


def _of_landmark(one: Landmark, grade: Grade) -> Reason:
    assert one.off_m is not None
    off = ", ".join(f"{value:+.2f} m {axis}" for value, axis in zip(one.off_m, ("east", "north", "up"), strict=True))
    words = f"{one.name} comes out {off} from its surveyed coordinates, {one.error_over_sigma:.1f} sigmas"
    if one.kind == "check":
        words = f"check point {words}: the answer is less sure than it says, or the point is not where it was said"
    advice = "look at its marks, its coordinates and their datum; raise sigma_m if the survey is less sure"
    return Reason(
        kind="check-point" if one.kind == "check" else "landmark", subject=one.name, words=words, advice=advice,
        grade=grade, figure=one.statistic, measure="chi-square with 3 degrees of freedom",
    )  # fmt: skip


def _of_ground(fit: GroundFit, sigma_m: float, statistic: float, grade: Grade) -> Reason:
    words = f"under {fit.target} the ground would have to be {fit.off_m:+.1f} m from where the model has it, with a "
    words += f"sigma of {sigma_m:g} m"
    advice = "look at the datum of the ground and of the cameras' heights, at above_ground_m, and at ground.sigma_m"
    return Reason(
        kind="ground", subject=fit.target, words=words, advice=advice, grade=grade, figure=statistic,
        measure="chi-square with 1 degrees of freedom",
    )  # fmt: skip
