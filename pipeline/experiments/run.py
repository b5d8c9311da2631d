"""An experiment from its name to its files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from calibration.foundation.errors import WriteError
from pipeline.experiments.pages.page import render_page
from pipeline.experiments.pages.tables import results_csv, runs_csv
from pipeline.experiments.paper.catalogue import experiment_named
from pipeline.experiments.running.runner import Progress, Workers, fly_all
from pipeline.experiments.statistics.summary import Outcome


def run_experiments(
    names: Sequence[str], *, runs: int, seed: int, workers: Workers, progress: Progress
) -> Iterator[Outcome]:
    """Fly experiments, one outcome after another. Raises UsageError where there is none of a name."""
    return fly_all([experiment_named(n) for n in names], runs=runs, seed=seed, workers=workers, progress=progress)


def run_experiment(name: str, *, runs: int, seed: int, workers: Workers, progress: Progress) -> Outcome:
    """Fly one. Raises UsageError where there is none of that name."""
    (outcome,) = run_experiments([name], runs=runs, seed=seed, workers=workers, progress=progress)
    return outcome


def write_outcome(outcome: Outcome, folder: Path) -> tuple[str, ...]:
    """`results.csv`, `runs.csv` and `NAME.html` in `folder`; returns their names. Raises WriteError."""
    experiment = outcome.experiment
    texts = {
        f"{experiment.name}.csv": results_csv(outcome),
        f"{experiment.name}-runs.csv": runs_csv(outcome),
        f"{experiment.name}.html": render_page(outcome),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            part = folder / f".{name}.part"
            part.write_text(text, encoding="utf-8", newline="\n")
            part.replace(folder / name)
    except OSError as error:
        raise WriteError(
            where=str(folder), seen=str(error), expected="a folder that can be written",
            advice="another --output, or more space",
        ) from None  # fmt: skip
    return tuple(texts)
