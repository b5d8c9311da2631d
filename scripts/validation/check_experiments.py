"""Every experiment flown, and what they must show: seconds, the verdict on map, ratios with their 95 % intervals.

usage: python -m scripts.validation.check_experiments [RUNS [JOBS [OUT [NAME ...]]]]     (default 1000 2 runs, all)

Ends with 1 where another method is nearer the truth than map in a cell, or map's error is 8 % above the bound, beyond
the Monte Carlo error.
"""

import math
import resource
import sys
import time
from pathlib import Path

from pipeline.experiments import EXPERIMENTS, Outcome, processes, run_experiments, sentence, verdict, write_outcome
from pipeline.experiments.statistics.figures import figure_of
from pipeline.experiments.statistics.ratios import of_means, of_medians
from pipeline.experiments.statistics.summary import TWO_SIDED
from pipeline.experiments.statistics.verdict import where
from scripts.validation.figures import tell

ALLOWED = 1.08


def ratio_lines(outcome: Outcome) -> list[str]:
    """The paper's algorithms and map over each other, beside the paper's figures and the bound."""
    e, lines = outcome.experiment, []
    pairs = [("Algorithm 2", "Algorithm 1"), ("map", "Algorithm 1"), ("map", "Algorithm 2")]
    for c in range(len(e.cells)):
        for name, base in pairs:
            entry = outcome.entry(c, e.approach(name))
            assert entry is not None
            for word, r in (("mean", of_means(outcome, entry, base)), ("median", of_medians(outcome, entry, base))):
                paper = f", paper {r.published:.3f}" if math.isfinite(r.published) else ""
                lines.append(
                    f"  {where(outcome, entry):<30}{name} / {base}, {word}: {r.value:.3f} "
                    f"({r.low:.3f} to {r.high:.3f}), bound {r.bound:.3f}{paper}"
                )
    return lines


def speed_lines(outcome: Outcome) -> list[str]:
    """Li over the others."""
    lines = []
    for entry in outcome.entries:
        name = outcome.experiment.approaches[entry.approach].name
        eight, end = (figure_of(outcome, entry, m) for m in ("quicker_than_li", "quicker_than_li_to_the_end"))
        paper = f", paper {eight.published:.1f}" if math.isfinite(eight.published) else ""
        lines.append(
            f"  {where(outcome, entry):<10}{name:<16}{1e3 * entry.solver_seconds.mean:8.2f} ms, "
            f"{entry.iterations.mean:5.1f} iterations or rounds; Li over it {eight.value:.1f} ({eight.low:.1f} to "
            f"{eight.high:.1f}){paper}; Li to the end over it {end.value:.1f} ({end.low:.1f} to {end.high:.1f})"
        )
    return lines


def shortfalls(outcome: Outcome) -> list[str]:
    """Where map is not what it must be."""
    e, found = outcome.experiment, verdict(outcome)
    lines = [
        f"  {where(outcome, x)}: {e.approaches[x.approach].name} is nearer by {-x.worse_m.mean:.3g} +- "
        f"{x.worse_m.error:.2g} m"
        for x in found.worse
    ]
    for c in range(len(e.cells)):
        x = outcome.entry(c, e.approach(e.reference))
        if x is not None and x.over_bound - TWO_SIDED * x.over_bound_error > ALLOWED:
            lines.append(f"  {where(outcome, x)}: map at {x.over_bound:.3f} +- {x.over_bound_error:.3f} of the bound")
    return lines


def over_bound(outcome: Outcome) -> str:
    """The reference over the bound, least and most of all cells."""
    e = outcome.experiment
    entries = [outcome.entry(c, e.approach(e.reference)) for c in range(len(e.cells))]
    values = [x.over_bound for x in entries if x is not None and x.over_bound == x.over_bound]
    return f"map over the bound {min(values):.3f} to {max(values):.3f}" if values else "no bound"


def main(runs: str = "1000", jobs: str = "2", out: str = "experiments", *names: str) -> int:
    """Prints a paragraph for each experiment as it is done."""
    short, began, all_began = 0, time.perf_counter(), time.perf_counter()
    outcomes = run_experiments(
        names or list(EXPERIMENTS), runs=int(runs), seed=1, workers=processes(int(jobs)), progress=lambda *_: None
    )
    for outcome in outcomes:
        write_outcome(outcome, Path(out))
        name = outcome.experiment.name
        print(f"{name}: {time.perf_counter() - began:.0f} s; {over_bound(outcome)}; {sentence(outcome)}", flush=True)
        began = time.perf_counter()
        lines = {"rotation": ratio_lines, "long-range": ratio_lines, "speed": speed_lines}.get(name, lambda _: [])(
            outcome
        )
        wrong, found = shortfalls(outcome), verdict(outcome)
        tell({name: {"better": found.better, "equal": found.equal, "worse": len(found.worse), "runs": int(runs),
                     "map_over_bound": over_bound(outcome), "lines": lines}})  # fmt: skip
        print("\n".join([*lines, *wrong]), flush=True)
        short += len(wrong)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = used.ru_utime + used.ru_stime
    print(f"in all {time.perf_counter() - all_began:.0f} s, {cpu_s:.0f} s of CPU; {short} shortfalls")
    return 1 if short else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
