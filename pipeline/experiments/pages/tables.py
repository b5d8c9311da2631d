"""An outcome as CSV: one row per cell and approach, and one row per run."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pipeline.experiments.flying.measure import MEASURES
from pipeline.experiments.statistics.ratios import Ratio, of_means
from pipeline.experiments.statistics.summary import Entry, Outcome

SUMMARY = (
    "runs",
    "solved",
    "converged",
    "error_m",
    "error_standard_error_m",
    "error_deviation_m",
    "median_error_m",
    "published",
    "bound_error_m",
    "rms_m",
    "bound_rms_m",
    "rms_over_bound",
    "rms_over_bound_standard_error",
    "east_rms_m",
    "north_rms_m",
    "up_rms_m",
    "bound_east_m",
    "bound_north_m",
    "bound_up_m",
    "error_less_reference_m",
    "error_less_reference_standard_error_m",
    "against_reference",
    "offset_error_mean_s",
    "offset_error_deviation_s",
    "bound_offset_s",
    "rate_error_mean",
    "rate_error_deviation",
    "bound_rate",
    "nees_per_degree_of_freedom",
    "nees_standard_error",
    "iterations",
)
BASES = ("Algorithm 1", "Algorithm 2")
RATIOS = tuple(f"over_{b.lower().replace(' ', '_')}{end}" for b in BASES for end in ("", "_low", "_high"))  # fmt: skip
TIMES = ("seconds", "solver_seconds")


def results_csv(outcome: Outcome) -> str:
    """One row per cell and approach."""
    factors = _factors(outcome)
    timed = TIMES if outcome.experiment.timed else ()
    lines = [",".join(["experiment", *factors, "approach", *SUMMARY, *RATIOS, *timed])]
    for e in outcome.entries:
        cell = outcome.experiment.cells[e.cell]
        head = [outcome.experiment.name, *(str(cell.values.get(f, "")) for f in factors)]
        name = outcome.experiment.approaches[e.approach].name
        times = [e.seconds.mean, e.solver_seconds.mean] if timed else []
        lines.append(
            ",".join([*head, _quoted(name), *(_figure(v) for v in (*_summary(e), *_ratios(outcome, e), *times))])
        )
    return "\n".join(lines) + "\n"


def _summary(e: Entry) -> Iterator[float | int | str]:
    yield from (
        e.runs,
        e.solved,
        e.converged,
        e.error_m.mean,
        e.error_m.error,
        e.error_m.deviation,
        e.median_m,
        e.published,
    )
    yield from (e.bound_m, e.rms_m, e.bound_rms_m, e.over_bound, e.over_bound_error, *e.axes_m, *e.bound_axes_m)
    yield from (e.worse_m.mean, e.worse_m.error, e.against_reference(), e.offset_s.mean, e.offset_s.deviation)
    yield from (e.bound_offset_s, e.rate.mean, e.rate.deviation, e.bound_rate, e.nees.mean, e.nees.error)
    yield e.iterations.mean


def _ratios(outcome: Outcome, entry: Entry) -> Iterator[float]:
    """Mean error over that of the paper's algorithms, with the ends of the 95 % interval."""
    flown = [a.name for a in outcome.experiment.approaches]
    for base in BASES:
        ratio = of_means(outcome, entry, base) if base in flown else Ratio()
        yield from (ratio.value, ratio.low, ratio.high)


def runs_csv(outcome: Outcome) -> str:
    """One row per run and approach: everything the summary is made of."""
    experiment = outcome.experiment
    columns = [i for i, name in enumerate(MEASURES) if experiment.timed or name not in TIMES]
    lines = [",".join(["cell", "run", "approach", *(MEASURES[i] for i in columns)])]
    for e in outcome.entries:
        name = _quoted(experiment.approaches[e.approach].name)
        for run, values in enumerate(outcome.runs[e.cell, :, e.approach][:, columns].tolist()):
            lines.append(f"{e.cell},{run},{name}," + ",".join(_figure(v) for v in values))
    return "\n".join(lines) + "\n"


def _factors(outcome: Outcome) -> list[str]:
    names: dict[str, None] = {}
    for cell in outcome.experiment.cells:
        names |= dict.fromkeys(cell.values)
    return list(names)


def _figure(value: float | int | str) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return str(value)


def _quoted(name: str) -> str:
    return f'"{name}"' if "," in name else name
