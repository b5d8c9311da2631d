"""Does the verdict say what is wrong, name who did it, and stay silent where nothing is?

usage: python -m scripts.validation.check_verdict [--flights 10] [--first-seed 0] [--ordinary 200] [--kinds swap,slide]

Flights and mistakes are drawn by a simulator of their own (`drawn_flights`, `drawn_mistakes`), offsets given to 50 ms.
Three shares are printed: of mistaken flights whose error exceeds two claims, how many are not called "good", and how
many have the culprit among the first two reasons; of ordinary flights, how many get "care" and "bad".
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.flight import read_flight
from pipeline.records import Reason
from pipeline.stages import run_solve
from scripts.validation.drawn_flights import Flight, draw, write
from scripts.validation.drawn_mistakes import KINDS, mistaken
from scripts.validation.figures import tell

FAR = 2.0


def solved(flight: Flight) -> tuple[str, tuple[Reason, ...], float]:
    """Grade, reasons and error over claim; a refusal has its text as a reason."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            results = run_solve(read_flight(write(flight, Path(folder))), Path(folder) / "out").results
        except RunningFixError as error:
            return "refused", (Reason(kind="refused", subject="", words=str(error)),), float("inf")
    error, claim = [], []
    for t in results.trajectories:
        off = t.position_enu_m - flight.motions[t.target](t.time_s)
        error.append((off**2).sum(axis=1))
        claim.append(t.sigma_m**2)
    ratio = float(np.sqrt((np.concatenate(error) / np.concatenate(claim)).mean()))
    return results.solution.verdict.grade, results.solution.verdict.reasons, ratio


def names_culprit(reasons: tuple[Reason, ...], names: set[str]) -> bool:
    """Whether one of the first two reasons names one of the culprits."""
    return any(name in reason.subject or name in reason.words for reason in reasons[:2] for name in names)


def _mistakes(kinds: list[str], seeds: range) -> None:
    far = said = named = 0
    for kind in kinds:
        row: Counter[str] = Counter()
        for seed in seeds:
            flight, names = mistaken(kind, seed)
            grade, reasons, ratio = solved(flight)
            row[grade] += 1
            if ratio > FAR:
                far, said, named = far + 1, said + (grade != "good"), named + names_culprit(reasons, names)
                row["far"] += 1
                row["named"] += names_culprit(reasons, names)
        shown = "  ".join(f"{key} {row[key]:>3}" for key in ("good", "care", "bad", "refused", "far", "named"))
        print(f"{kind:<18}{shown}", flush=True)
    tell({"beyond_two_claims": far, "not_good": said, "culprit_named": named})
    print(f"of {far} beyond {FAR:g} claims {said} are not good ({said / max(far, 1):.1%})")
    print(f"and {named} have the culprit among the first two ({named / max(far, 1):.1%})")


def _ordinary(seeds: range) -> None:
    grades: Counter[str] = Counter()
    ratios = []
    for seed in seeds:
        flight = draw(seed)
        if not flight.motions:
            continue
        for one in flight.cameras[1:]:
            one.told["offset_s"], one.told_sigma["offset_s"] = round(one.begin_s, 2), 0.05
        grade, reasons, ratio = solved(flight)
        grades[grade] += 1
        ratios.append(min(ratio, 99.0))
        if grade != "good":
            print(f"  ordinary {seed}: {grade}, {ratio:.2f} claims: {reasons[0].kind} {reasons[0].words}", flush=True)
    shown = ", ".join(f"{grade} {count}" for grade, count in grades.items())
    print(f"{sum(grades.values())} ordinary flights: {shown}")
    tell({"ordinary": dict(grades)})
    print(f"error over claim {np.sqrt(np.mean(np.square(ratios))):.2f}")


def main() -> None:
    """Draws, solves, counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--ordinary", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    given = parser.parse_args()
    began = time.perf_counter()
    _ordinary(range(given.first_seed, given.first_seed + given.ordinary))
    _mistakes([k for k in given.kinds.split(",") if k], range(given.first_seed, given.first_seed + given.flights))
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
