"""Cameras that swing at 20 degrees/s and are read out in 20 ms: given, refined, ignored, beside a global shutter.

usage: python -m scripts.validation.check_rolling_shutter [--flights 50] [--first 0] [--rows FILE]

Flights of `drawn_shutters.py`, the same but for the readout. Printed: error (3D, root mean square over all targets,
metres) and error over claim; of the refined readouts how many are within 3 of their sigmas, and the root mean square of
error over sigma; of the ignored ones in how many flights the verdict says so, and in how many with a global shutter.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.flight import read_flight
from pipeline.stages import run_solve
from scripts.validation.drawn_flights import write
from scripts.validation.drawn_shutters import shuttered
from scripts.validation.figures import tell
from scripts.validation.series import rows_of

READOUT_S, LOOSE_S = 0.02, 0.03
KINDS = ("global", "given", "refined", "ignored")


def made(key: str) -> dict:
    """What is kept of "KIND SEED"."""
    kind, seed = key.split()
    flight = shuttered(int(seed), 0.0 if kind == "global" else READOUT_S)
    if not flight.motions or any(not cam.tracks for cam in flight.cameras):
        return {"solved": False}
    for cam in flight.cameras:
        cam.told |= {"readout_s": READOUT_S} if kind == "given" else {}
        cam.told_sigma |= {"readout_s": LOOSE_S} if kind == "refined" else {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            results = run_solve(read_flight(write(flight, Path(folder))), Path(folder) / "out").results
        except RunningFixError as error:
            return {"solved": False, "words": str(error)}
    off, claim = [], []
    for path in results.trajectories:
        off.append(((path.position_enu_m - flight.motions[path.target](path.time_s)) ** 2).sum(axis=1).mean())
        claim.append((path.sigma_m**2).mean())
    reasons = results.solution.verdict.reasons
    return {
        "solved": True,
        "off_m2": float(np.mean(off)),
        "claim_m2": float(np.mean(claim)),
        "grade": results.solution.verdict.grade,
        "said": [reason.subject for reason in reasons if reason.kind == "rolling-shutter"],
        "readout": [[b.readout_s, b.readout_sigma_s] for b in results.solution.biases],
    }


def main() -> None:
    """Draws, solves, prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", type=Path, help="file to which rows are appended; what it has is not solved again")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.flights)
    found = {key["key"]: key for key in rows_of((f"{k} {s}" for s in seeds for k in KINDS), made, given.rows)}
    whole = [s for s in seeds if all(found[f"{kind} {s}"]["solved"] for kind in KINDS)]
    rows = {kind: [found[f"{kind} {seed}"] for seed in whole] for kind in KINDS}
    print(f"{len(whole)} of {len(seeds)} flights (in the others a camera sees too little)")
    error = {kind: float(np.sqrt(np.mean([r["off_m2"] for r in rows[kind]]))) for kind in KINDS}
    typical = {kind: float(np.median(np.sqrt([r["off_m2"] for r in rows[kind]]))) for kind in KINDS}
    for kind in KINDS:
        claim = np.sqrt(np.mean([r["claim_m2"] for r in rows[kind]]))
        said = sum(bool(r["said"]) for r in rows[kind])
        grades = {grade: sum(r["grade"] == grade for r in rows[kind]) for grade in ("good", "care", "bad")}
        print(
            f"{kind:8s} error {error[kind]:.3f} m (median {typical[kind]:.3f}), over global "
            f"{error[kind] / error['global']:.3f}, over claim {error[kind] / claim:.2f}, said in {said}, {grades}"
        )
    readouts = np.array([pair for r in rows["refined"] for pair in r["readout"]])
    z = (readouts[:, 0] - READOUT_S) / readouts[:, 1]
    within, root = float((np.abs(z) < 3).mean()), float(np.sqrt((z**2).mean()))
    print(f"refined: {within:.1%} of {len(z)} within 3 sigma, error over sigma {root:.2f}, ", end="")
    print(f"median sigma {1e3 * np.median(readouts[:, 1]):.2f} ms, mean {1e3 * readouts[:, 0].mean():.2f} ms")
    tell({
        "flights": len(whole),
        **{f"{kind}_over_global": error[kind] / error["global"] for kind in KINDS[1:]},
        "refined_within_3_sigma": within,
        "refined_error_over_sigma": root,
        "ignored_said": sum(bool(r["said"]) for r in rows["ignored"]) / len(whole),
        "global_said": sum(bool(r["said"]) for r in rows["global"]) / len(whole),
    })  # fmt: skip


if __name__ == "__main__":
    main()
