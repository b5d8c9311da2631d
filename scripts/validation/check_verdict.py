"""Does the verdict say what is wrong, name who did it, and stay silent where nothing is?

usage: python -m scripts.validation.check_verdict [--flights 10] [--first-seed 0] [--ordinary 200] [--kinds swap,slide]
       [--rows FILE]

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
from scripts.validation.series import Row, rows_of

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


def row(flight: Flight, names: set[str]) -> Row:
    """What is kept of one flight; `names` of which one is to be among the culprits."""
    began = time.perf_counter()
    grade, reasons, ratio = solved(flight)
    return {
        "grade": grade, "ratio": min(ratio, 999.0), "names": sorted(names), "named": names_culprit(reasons, names),
        "reasons": [f"{r.grade} {r.kind} {r.subject}: {r.words}" for r in reasons],
        "seconds": time.perf_counter() - began,
    }  # fmt: skip


def mistaken_row(key: str) -> Row:
    """Of "KIND SEED"."""
    kind, seed = key.split()
    return row(*mistaken(kind, int(seed)))


def ordinary_row(key: str) -> Row:
    """Of "ordinary SEED"."""
    flight = draw(int(key.split()[1]))
    if not flight.motions:
        return {"grade": "", "ratio": 0.0, "reasons": []}
    for one in flight.cameras[1:]:
        one.told["offset_s"], one.told_sigma["offset_s"] = round(one.begin_s, 2), 0.05
    return row(flight, set())


def _shown(r: Row) -> str:
    heavy = [reason[:170] for reason in r["reasons"] if not reason.startswith("good")]
    return "".join(f"\n       {reason}" for reason in heavy[:2])


def _mistakes(kinds: list[str], seeds: range, kept: Path | None) -> None:
    far = said = named = 0
    silent = []
    for kind in kinds:
        count: Counter[str] = Counter()
        for r in rows_of((f"{kind} {seed}" for seed in seeds), mistaken_row, kept):
            count[r["grade"]] += 1
            if r["ratio"] > FAR:
                far, said, named = far + 1, said + (r["grade"] != "good"), named + r["named"]
                count["far"] += 1
                count["named"] += r["named"]
                silent += [r["key"]] if r["grade"] == "good" else []
                if r["grade"] == "good" or not r["named"]:
                    print(f"  {r['key']}: {r['grade']}, {r['ratio']:.1f} claims, culprit {r['names']}{_shown(r)}")
        shown = "  ".join(f"{key} {count[key]:>3}" for key in ("good", "care", "bad", "refused", "far", "named"))
        print(f"{kind:<18}{shown}", flush=True)
    tell({"beyond_two_claims": far, "not_good": said, "culprit_named": named, "silent": silent})
    print(f"of {far} beyond {FAR:g} claims {said} are not good ({said / max(far, 1):.1%})")
    print(f"and {named} have the culprit among the first two ({named / max(far, 1):.1%})")


def _ordinary(seeds: range, kept: Path | None) -> None:
    grades: Counter[str] = Counter()
    ratios = []
    for r in rows_of((f"ordinary {seed}" for seed in seeds), ordinary_row, kept):
        if not r["grade"]:
            continue
        grades[r["grade"]] += 1
        ratios.append(min(r["ratio"], 99.0))
        if r["grade"] != "good" or r["ratio"] > FAR:
            print(f"  {r['key']}: {r['grade']}, {r['ratio']:.2f} claims{_shown(r)}", flush=True)
    shown = ", ".join(f"{grade} {count}" for grade, count in grades.items())
    print(f"{sum(grades.values())} ordinary flights: {shown}")
    tell({"ordinary": dict(grades)})
    print(f"error over claim {np.sqrt(np.mean(np.square(ratios))) if ratios else np.nan:.2f}")


def main() -> None:
    """Draws, solves, counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--ordinary", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--rows", type=Path, help="file to which rows are appended; what it has is not solved again")
    given = parser.parse_args()
    began = time.perf_counter()
    _ordinary(range(given.first_seed, given.first_seed + given.ordinary), given.rows)
    kinds = [k for k in given.kinds.split(",") if k]
    _mistakes(kinds, range(given.first_seed, given.first_seed + given.flights), given.rows)
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
