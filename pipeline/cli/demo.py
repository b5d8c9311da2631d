"""`runningfix demo`: the whole mission on a rendered flight, next to its truth."""

from __future__ import annotations

import math
from argparse import Namespace

from calibration.foundation.errors import DID_NOT_CONVERGE
from pipeline.cli.console import Console
from pipeline.cli.flights import machine_summary, solved_in
from pipeline.demo import DemoSummary, run_demo


def run(arguments: Namespace, console: Console) -> int:
    """Renders, calibrates, runs and compares; 0, or 7 where the verdict is bad."""
    console.say(f"rendering a flight into {arguments.output}, then processing it as a user would")
    found = run_demo(arguments.output, seed=arguments.seed, progress=console.progress)
    out = arguments.output / "out"
    summary = machine_summary(found.run, out, solved_in(out)) | {
        "command": "demo",
        "seconds": {name: round(value, 3) for name, value in found.seconds.items()},
        "comparison": [
            {
                "what": c.what,
                "unit": c.unit,
                "before": _finite(c.before),
                "after": _finite(c.after),
                "sigma": _finite(c.sigma),
            }
            for c in found.results.comparison
        ],
    }
    console.result(summary, table(found))
    return DID_NOT_CONVERGE if found.results.solution.verdict.grade == "bad" else 0


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def table(found: DemoSummary) -> str:
    """The comparison with the truth, for people."""
    head = f"{'error of':<28}{'before':>12}{'after':>12}{'claimed':>12}"
    rows = [f"{c.what:<28}{c.before:>12.4g}{c.after:>12.4g}{c.sigma:>12.4g} {c.unit}" for c in found.results.comparison]
    folder = found.flight.parent
    steps = [f"runningfix calibrate {p} --board 9x6 --square-mm 25 -o {folder / p.name[6:]}.json"
             for p in sorted(folder.glob("board-*"))]  # fmt: skip
    steps.append(f"runningfix run {found.flight} -o {folder / 'out'}")
    seconds = "  ".join(f"{name} {value:.1f} s" for name, value in found.seconds.items())
    return "\n".join(
        [head, *rows, "", seconds, "", "the same by hand:", *(f"  {s}" for s in steps), "",
         f"look at {folder / 'out' / 'report.html'}"]
    )  # fmt: skip
