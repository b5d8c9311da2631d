"""Writes one of the rendered flights: `python -m pipeline.synthetic FOLDER --scene small --seed 11`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from calibration.foundation.errors import RunningFixError
from pipeline.synthetic import Quality, demo_scene, small_scene, write_flight

SCENES = {"demo": (demo_scene, Quality()), "small": (small_scene, Quality(crf=20, photos=14, jpeg=90, pixel_px=0.2))}


def main() -> int:
    """Exit code: 0, or that of the error that is told."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.synthetic", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scene", choices=sorted(SCENES), default="small")
    parser.add_argument("--seed", type=int, default=11)
    chosen = parser.parse_args()
    make, quality = SCENES[chosen.scene]
    try:
        write_flight(make(chosen.seed), chosen.folder, seed=chosen.seed, quality=quality)
    except RunningFixError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
