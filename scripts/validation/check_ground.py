"""One camera over cars on the ground: errors against what is claimed, hovering and flying, level and hilly.

usage: python -m scripts.validation.check_ground [--flights 50] [--first 0]

Flights of `drawn_ground.py`, whose attitudes are good to 0.5 degrees (bias and frame by frame). Printed for each kind:
root mean square error and claim (3D, metres), their ratio, and the root of the mean of e' C^-1 e / 3, which is one if
claims are true; over all cars at five times each.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from calibration.foundation.errors import RunningFixError
from pipeline.flight import read_flight
from pipeline.stages import run_solve
from scripts.validation.drawn_ground import draw
from scripts.validation.figures import tell

KINDS = (("level", 10.0), ("hilly", 10.0), ("hilly", 1.0))
PATHS = ("hover", "straight")


def errors_of(summary, motions):
    """Errors (n, 3) and claimed covariances (n, 3, 3), five times a car."""
    errors, claims = [], []
    for one in summary.results.trajectories:
        row = np.unique(np.linspace(0, len(one.time_s) - 1, 7)[1:-1].astype(int))
        errors.append(one.position_enu_m[row] - motions[one.target](one.time_s[row]))
        claims.append(one.covariance[row])
    return np.concatenate(errors), np.concatenate(claims)


def main() -> None:
    """Draws, solves, prints."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--show", action="store_true", help="every flight")
    given, figures = parser.parse_args(), {}
    print("ground  cells camera    flights refused  error m  claim m  ratio  root NEES/3  verdicts not good")
    for kind, cell_m in KINDS:
        for path in PATHS:
            errors, claims, refused, doubted = [], [], 0, 0
            for seed in range(given.first, given.first + given.flights):
                with tempfile.TemporaryDirectory() as name:
                    file, motions, kinds = draw(seed, kind, path, Path(name), cell_m=cell_m)
                    try:
                        summary = run_solve(read_flight(file), Path(name) / "out")
                    except RunningFixError as error:
                        refused += 1
                        if given.show:
                            print(seed, "refused:", error)
                        continue
                e, c = errors_of(summary, motions)
                doubted += summary.results.solution.verdict.grade != "good"
                if given.show:
                    nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(c), e).reshape(-1, 1).mean() / 3
                    off = np.sqrt((e**2).sum(1).mean()), np.sqrt(np.trace(c, axis1=1, axis2=2).mean())
                    orders = [
                        (m.target, kinds[m.target], m.kind[:4], m.degree) for m in summary.results.solution.motions
                    ]
                    print(seed, f"{off[0]:.2f} {off[1]:.2f} {np.sqrt(nees):.2f}", orders, flush=True)
                errors.append(e)
                claims.append(c)
            e, c = np.concatenate(errors), np.concatenate(claims)
            rms, claim = np.sqrt((e**2).sum(1).mean()), np.sqrt(np.trace(c, axis1=1, axis2=2).mean())
            root = np.sqrt(np.einsum("ni,nij,nj->n", e, np.linalg.inv(c), e).mean() / 3)
            print(
                f"{kind:7s} {cell_m:4.0f} {path:9s} {given.flights:7d} {refused:7d} {rms:8.2f} {claim:8.2f} "
                f"{rms / claim:6.2f} {root:8.2f} {doubted:12d}", flush=True,
            )  # fmt: skip
            figures[f"{kind}_{cell_m:g}m_{path}_error_over_claim"] = root
            figures[f"{kind}_{cell_m:g}m_{path}_error_m"] = rms
    tell(figures)


if __name__ == "__main__":
    main()
