"""What the judgement calls unlikely. Every constant here moves the line between "good", "care" and "bad".

`scripts/validation/check_verdict.py` measures what they give on flights drawn by a simulator of its own. The aim: of
flights without a mistake at most 3 of 100 get "care" or worse and 1 of 200 "bad"; of flights with a mistake that moves
the answer by more than two of its own sigmas at most 2 of 100 are "good".
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class JudgementSettings:
    """Thresholds, as chances that a flight whose claims are true goes as far, all tests of a kind together.

    prior_care, prior_bad  chance (log10) of a block's correction; ten times smaller: a tenth of the false alarms
    heights_care     chance (log10) of a camera's height against the others', the mistake that is made most
    fit_care, fit_bad      unit-weight and misfit z (a normal deviate); one more: a fifth to a tenth of the false alarms
    factor_care, factor_bad  variance factor below which a misfit is not spoken of, however sure: sigmas are guesses
    sequence_care, sequence_bad  chance (log10) of a camera's pose errors as a sequence
    marked_sigmas    of one parameter's correction, in prior sigmas, from which on it is marked: 3 of 1000 go as far by
                     chance. A mark lowers no verdict, the block's chance does; 4 would mark 1 in 16,000
    alike            correlation of neighbouring pose errors below which nothing is said
    unmoved_sigmas   how far the answer may move when a doubted track is left out, in its own claims, for the doubt to
                     cost no more than "care"; twice as much lets flights pass whose error a slid track has doubled
    depth_share      sigma over depth from which on a symmetric sigma does not hold
    readout_care     chance (log10) of all cameras' readouts; ten times smaller: a tenth of the false alarms
    readout_named    sigmas from which on a camera is then named
    readout_least_s  readout below which nothing is said: at 20 degrees/s its last row is off by 0.02 degrees
    readout_moves    sigmas by which it would move a motion, from which on that asks for care
    """

    prior_care: float = -4.0
    prior_bad: float = -9.0
    heights_care: float = -3.0
    fit_care: float = 4.5
    fit_bad: float = 8.0
    factor_care: float = 1.15
    factor_bad: float = 3.0
    sequence_care: float = -4.0
    sequence_bad: float = -12.0
    marked_sigmas: float = 3.0
    alike: float = 0.1
    unmoved_sigmas: float = 1.0
    depth_share: float = 0.05
    readout_care: float = -4.5
    readout_named: float = 3.0
    readout_least_s: float = 0.002
    readout_moves: float = 0.5


SETTINGS = JudgementSettings()
