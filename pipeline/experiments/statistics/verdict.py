"""Whether the reference is as good as it must be: never worse than another approach, better where the bound allows."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.experiments.statistics.summary import TWO_SIDED, Entry, Outcome


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The reference against every other approach in every cell, beyond the Monte Carlo error (95 %, run by run).

    better, equal  how many of the comparisons
    worse          entries that are nearer the truth than the reference
    missed         entries above the bound, so that there is room, but than which the reference is not better
    """

    better: int
    equal: int
    worse: tuple[Entry, ...]
    missed: tuple[Entry, ...]

    @property
    def compared(self) -> int:
        """Comparisons in all."""
        return self.better + self.equal + len(self.worse)


def verdict(outcome: Outcome) -> Verdict:
    """The verdict on an experiment's reference."""
    e = outcome.experiment
    words = [(x, x.against_reference()) for x in outcome.entries if e.approaches[x.approach].name != e.reference]
    return Verdict(
        better=sum(word == "worse" for _, word in words),
        equal=sum(word == "equal" for _, word in words),
        worse=tuple(x for x, word in words if word == "better"),
        missed=tuple(x for x, word in words if word == "equal" and above_bound(x)),
    )


def above_bound(entry: Entry) -> bool:
    """Whether an approach's root mean square error is above the bound's, beyond the Monte Carlo error."""
    return bool(entry.over_bound - 1 > TWO_SIDED * entry.over_bound_error)


def sentence(outcome: Outcome) -> str:
    """The verdict for people."""
    found, name = verdict(outcome), outcome.experiment.reference
    text = (
        f"{name} against the other approaches, {found.compared} comparisons of {outcome.runs.shape[1]} flights each: "
        f"nearer the truth in {found.better}, the same within the Monte Carlo error in {found.equal}, "
        f"farther in {len(found.worse)}"
    )
    if found.missed:
        text += f"; in {len(found.missed)} of the same ones the other is above the bound"
    return text


def where(outcome: Outcome, entry: Entry) -> str:
    """A cell in words."""
    values = outcome.experiment.cells[entry.cell].values
    return ", ".join(f"{k.replace('_', ' ')} {v}" for k, v in values.items())
