"""The demo's flight, rendered and run as `scripts/demo` does it: every error against the truth, and the claimed sigma.

usage: python -m scripts.validation.check_demo [--seed 7]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from pipeline.demo import run_demo
from scripts.validation.figures import tell


def main() -> None:
    """Prints the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=7)
    with tempfile.TemporaryDirectory() as folder:
        found = run_demo(Path(folder), seed=parser.parse_args().seed, progress=lambda *_: None)
    for row in found.results.comparison:
        print(f"{row.what:<28}{row.before:>12.4g}{row.after:>12.4g}{row.sigma:>12.4g} {row.unit}")
        tell({row.what: {"before": row.before, "after": row.after, "sigma": row.sigma, "unit": row.unit}})
    tell({"seconds": found.seconds})


if __name__ == "__main__":
    main()
