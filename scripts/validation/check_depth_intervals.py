"""Do the intervals of distances hold where base lines are narrow? Two cameras 15 m apart, 360 m from their targets.

usage: python -m scripts.validation.check_depth_intervals [--flights 50] [--seed 5000] [--base-line-m 15] [--away-m 360]
       [--rows FILE]

Flights are those of `check_ordinary_flights`, 10 s long, nothing known of the clocks. Of every target whose distance is
given with an interval, the true distance has to be within it 68 and 95 times in 100.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.records import SolverSettings
from pipeline.solver import solve
from scripts.validation.check_ordinary_flights import Drawn, drawn
from scripts.validation.figures import tell
from scripts.validation.series import Row, rows_of

SECONDS = 10.0


def row(flight: Drawn) -> Row:
    """Of every target with an interval: true distance, the one found, and the intervals."""
    try:
        solution = solve(flight.problem, SolverSettings())
    except RunningFixError as error:
        return {"refused": str(error), "depths": []}
    depths = []
    for d in solution.depths:
        time_s, place = flight.places[d.camera]
        station = np.array([np.interp(d.time_s, time_s, place[:, k]) for k in range(3)])
        point = flight.paths[int(d.target.removeprefix("car")) - 1](np.array([d.time_s]))[0]
        depths.append([float(np.linalg.norm(point - station)), d.depth_m, *d.within_68_m, *d.within_95_m, d.sigma_m])
    return {"refused": "", "grade": solution.verdict.grade, "targets": len(solution.motions), "depths": depths}


def main() -> None:
    """Prints a row for every target and the coverage over all."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--base-line-m", type=float, default=15.0)
    parser.add_argument("--away-m", type=float, default=360.0)
    parser.add_argument("--rows", type=Path, help="file to which rows are appended; what it has is not solved again")
    asked = parser.parse_args()
    narrow = asked.base_line_m, asked.away_m

    def make(key: str) -> Row:
        return row(drawn(int(key.split()[-1]), cameras=2, duration_s=SECONDS, narrow=narrow))

    depths, targets, refused = [], 0, 0
    for r in rows_of((f"narrow {s}" for s in range(asked.seed, asked.seed + asked.flights)), make, asked.rows):
        refused += bool(r["refused"])
        targets += r.get("targets", 0)
        depths += r["depths"]
        for true, found, low68, high68, low95, high95, sigma in r["depths"]:
            where = "in" if low68 <= true <= high68 else "95" if low95 <= true <= high95 else "out"
            print(
                f"{r['key']}: {true:7.1f} m, found {found:7.1f} +- {sigma:6.1f}, {low95:7.1f} to {high95:7.1f} {where}",
                flush=True,
            )
    d = np.array(depths).reshape(-1, 7)
    in68, in95 = ((d[:, 0] >= d[:, k]) & (d[:, 0] <= d[:, k + 1]) for k in (2, 4))
    print(f"{len(d)} intervals of {targets} targets, {refused} refused; within: {in68.mean():.3f}, {in95.mean():.3f}")
    tell({"intervals": len(d), "targets": targets, "within_68": float(in68.mean()), "within_95": float(in95.mean())})


if __name__ == "__main__":
    main()
