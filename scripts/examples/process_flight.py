"""A whole flight over the Python API: every stage, resumed where it was stopped, then where each target went.

usage: python scripts/examples/process_flight.py flight.toml out/
"""

import sys
from pathlib import Path

import pandas as pd

from pipeline.flight import read_flight
from pipeline.stages import run_flight


def main(flight_file: str, output: str) -> None:
    """Runs every stage and prints each target's way."""
    out = Path(output)
    run_flight(read_flight(Path(flight_file)), out)
    for target, rows in pd.read_csv(out / "trajectory.csv").groupby("target"):
        first, last = rows.iloc[0], rows.iloc[-1]
        speed = (rows.ve_mps**2 + rows.vn_mps**2) ** 0.5
        print(
            f"{target}: from ({first.east_m:.1f}, {first.north_m:.1f}) to ({last.east_m:.1f}, {last.north_m:.1f}) m "
            f"in {last.time_s - first.time_s:.1f} s, mean {speed.mean():.1f} m/s"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
