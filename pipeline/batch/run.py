"""A batch: what is finished is found, the rest is spread, each outcome is kept as it comes, and the whole is told."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from calibration.foundation.progress import Progress, silent
from pipeline.batch.dataset import arrow, catalogue_parquet
from pipeline.batch.flying import Flown, Task
from pipeline.batch.kept_state import State, opened
from pipeline.batch.limits import Limits
from pipeline.batch.outcome import FlightOutcome
from pipeline.batch.page import batch_page
from pipeline.batch.places import check_place
from pipeline.batch.spread import Spread
from pipeline.batch.which import NamedFlight

PUBLISH_S = 30.0
"""Between two catalogues while flights are still coming, so that one can look on. More often only costs writing."""


@dataclass(frozen=True, kw_only=True)
class BatchSummary:
    """A batch that came to its end: every flight's outcome, which were found finished, and what had to be said."""

    outcomes: tuple[FlightOutcome, ...]
    found_finished: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float

    def count(self) -> dict[str, int]:
        """Flights by status, and those that are done by verdict."""
        statuses = Counter(o.status for o in self.outcomes)
        verdicts = Counter(o.verdict for o in self.outcomes if o.verdict)
        return {**{name: statuses[name] for name in statuses}, **{name: verdicts[name] for name in verdicts}}


def run_batch(
    flights: Sequence[NamedFlight],
    out: str,
    spread: Spread,
    *,
    limits: Limits,
    again: bool = False,
    progress: Progress = silent,
    tell: Callable[[FlightOutcome], None] = lambda outcome: None,
) -> BatchSummary:
    """Does every flight that is not finished; `again` also those that failed before and have not changed.

    `out` is a folder or a URL; `tell` hears of every flight as it ends. Raises RunningFixError where the data set
    cannot be written.
    """
    check_place(out)
    arrow()
    begin = time.perf_counter()
    with opened(out) as state:
        known = state.known()
        asked = {flight.name for flight in flights}
        others = [outcome for name, outcome in known.items() if name not in asked]
        gathering = _Gathering(state, len(flights), others, progress, tell)
        if again:
            known = {name: outcome for name, outcome in known.items() if outcome.status == "done"}
        tasks = [Task(flight=flight, out=out, limits=limits, known=known.get(flight.name)) for flight in flights]
        for _, flown in spread(tasks):
            gathering.take(flown)
        gathering.publish()
    return BatchSummary(
        outcomes=tuple(gathering.outcomes[flight.name] for flight in flights),
        found_finished=tuple(gathering.found),
        notes=tuple(gathering.notes),
        seconds=time.perf_counter() - begin,
    )


class _Gathering:
    """Outcomes as they come; `others` are in the data set from another time."""

    def __init__(
        self,
        state: State,
        total: int,
        others: Sequence[FlightOutcome],
        progress: Progress,
        tell: Callable[[FlightOutcome], None],
    ) -> None:
        self.state, self.total, self.others, self.progress, self.tell = state, total, others, progress, tell
        self.outcomes: dict[str, FlightOutcome] = {}
        self.found: list[str] = []
        self.notes: list[str] = []
        self.published_s = time.monotonic()
        progress("flights", 0, total)

    def take(self, flown: Flown) -> None:
        """Keeps one, tells it, and now and then writes the catalogue."""
        outcome = flown.outcome
        self.outcomes[outcome.name] = outcome
        if flown.found_finished:
            self.found.append(outcome.name)
        else:
            self.notes += self.state.keep(outcome, flown.table)
        self.tell(outcome)
        self.progress("flights", len(self.outcomes), self.total)
        if time.monotonic() - self.published_s > PUBLISH_S:
            self.publish()

    def publish(self) -> None:
        """Catalogue and page of what is known."""
        done = [*self.others, *self.outcomes.values()]
        self.notes += self.state.publish(
            {
                "catalogue.parquet": catalogue_parquet(done),
                "index.html": batch_page(done, self.total + len(self.others)),
            }
        )
        self.published_s = time.monotonic()
