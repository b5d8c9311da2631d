"""Whether an answer may be used, and what speaks against it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Grade = Literal["good", "care", "bad"]
GRADES: tuple[Grade, ...] = ("good", "care", "bad")
"""From the best to the worst. "bad": do not use this."""


@dataclass(frozen=True, kw_only=True)
class Reason:
    """One thing that speaks against an answer.

    kind     short name, for example "prior-contradicted", "unit-weight", "suspect"
    subject  camera, target, "camera: target", or "" for the whole flight
    words    one or two sentences a person understands
    advice   what to try
    grade    how far it lowers the verdict
    figure   the number it rests on, and in `measure` what kind of number that is; NaN where it rests on none
    """

    kind: str
    subject: str
    words: str
    advice: str = ""
    grade: Grade = "care"
    figure: float = math.nan
    measure: str = ""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The worst grade of all reasons, and the reasons, the likeliest culprit first."""

    grade: Grade = "good"
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Correction:
    """How far the adjustment moved one parameter of a camera from where its prior has it.

    parameter    its name in `Solution.shared_names`, with the camera before it
    block        what is judged as one: "attitude", "position", "focal", "offset", "frame-rate", "start" or "place"
    value        estimate less prior mean: rad, m, s, Hz, px; a focal length's relative
    prior_sigma, sigma   one standard deviation before, and after, the larger of plain and robust, in the same unit
    in_sigmas    the correction in prior sigmas
    beyond       whether that is further than the judgement lets pass unmarked
    chi_square, freedom  of the block, with the grade that the judgement gives it
    """

    camera: str
    parameter: str
    block: str
    value: float
    prior_sigma: float
    sigma: float
    in_sigmas: float
    beyond: bool = False
    chi_square: float = math.nan
    freedom: int = 0
    grade: Grade = "good"


@dataclass(frozen=True, kw_only=True)
class DepthRange:
    """How far a target was, where that is so unsure that a symmetric sigma would mislead.

    Seen from `camera` in the middle of its track, at common time `time_s`, metres along the sight ray. `within_68_m`
    and `within_95_m` hold in 68 and 95 of 100 flights; an upper end may be infinite: nothing says how far at most.
    """

    target: str
    camera: str
    time_s: float
    depth_m: float
    sigma_m: float
    within_68_m: tuple[float, float]
    within_95_m: tuple[float, float]


def worst(grades: tuple[Grade, ...]) -> Grade:
    """The worst of some grades; "good" of none."""
    return max(grades, key=GRADES.index, default="good")
