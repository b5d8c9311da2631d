"""Tables of DataFlash messages: their log time, and those of one instance, receiver or estimator core.

Times are TimeUS (or TimeMS) since boot, except in GPS of old firmware, where TimeMS is the GPS week's and T the boot's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints, distinct
from pipeline.telemetry.clocks.clock_model import settled
from pipeline.telemetry.log.receiver import FIX_3D
from pipeline.telemetry.log.tables import MessageTable, RawLog, joined_tables

RECEIVERS = (("GPS", "GPA"), ("GPS2", "GPA2"), ("GPSB", "GPAB"))
"""Messages of a receiver and of what it is worth: of the first, of the second and the blended one before 4.1."""
GPS_NAMES = frozenset(name for name, _ in RECEIVERS)


def clock_field(table: MessageTable) -> tuple[str, float]:
    """The field that says the time since boot, and its ticks in a second; "" where none does."""
    if table.name in GPS_NAMES and "Week" in table:  # TimeMS is the week's
        return ("T", 1e3) if "T" in table else ("", 1.0)
    return next(((name, ticks) for name, ticks in (("TimeUS", 1e6), ("TimeMS", 1e3)) if name in table), ("", 1.0))


def time_of(table: MessageTable) -> Floats:
    """Log time (n,): seconds since boot; NaN where the message has none or its neighbours deny it."""
    field, ticks = clock_field(table)
    return settled(table.floats(field or "TimeMS") / ticks)


def first_instance(table: MessageTable | None) -> tuple[MessageTable | None, int]:
    """The messages of the first instance, where messages name one by a number; and how many instances there are."""
    if table is None:
        return None, 0
    instance = table.floats("I")
    named = distinct(instance[np.isfinite(instance)])
    return (table, 1) if not len(named) else (table.only(np.asarray(instance == named[0])), len(named))


def gps_in_use(raw: RawLog) -> MessageTable | None:
    """GPS of the receiver in use (U) then; where nothing says it, of the first that has a 3D fix, else of the first."""
    found = _receivers(raw)
    used = [t.only(np.asarray(t.floats("U") == 1)) for t, _ in found]
    used = [t for t in used if len(t)]
    if used:
        return _in_order(used)
    fixed = (t for t, _ in found if (t.floats("Status") >= FIX_3D).any())
    return next(fixed, found[0][0] if found else None)


def receivers_by_turns(raw: RawLog) -> tuple[str, ...]:
    """A note where more than one receiver was in use (U): places may step where one takes over from another."""
    tables = [t for t, _ in _receivers(raw)]
    used = [i for i, t in enumerate(tables) if (t.floats("U") == 1).any()]
    if len(used) < 2:
        return ()
    places = [tables[i].place[tables[i].floats("U") == 1] for i in used]
    whose = np.repeat(used, [len(place) for place in places])[np.argsort(np.concatenate(places), kind="stable")]
    turns = int(np.count_nonzero(np.diff(whose)))
    said = " and ".join(str(i) for i in used)
    return (f"receivers {said} are in use by turns, {turns} changes: places step where theirs differ",)


def accuracy_in_use(raw: RawLog) -> MessageTable | None:
    """GPA of the receiver that gives most of the messages in use; else of the first."""
    found, gps = _receivers(raw), gps_in_use(raw)
    if gps is None:
        return first_instance(raw.table("GPA"))[0]
    shares = [_shared(gps.place, t.place) for t, _ in found]
    mine = found[int(np.argmax(shares))][1]
    return next((t for _, t in found if t is not None), None) if mine is None else mine


def _shared(places: Ints, others: Ints) -> int:
    """How many places (n,) are among others (m,), both in order."""
    at = np.minimum(np.searchsorted(others, places), len(others) - 1)
    return int(np.count_nonzero(others[at] == places)) if len(others) else 0


def _receivers(raw: RawLog) -> list[tuple[MessageTable, MessageTable | None]]:
    """The messages and accuracies of each receiver: by instance (I), of old firmware by the name of the message."""
    found = []
    for name, accuracy in RECEIVERS:
        table, stated = raw.table(name), raw.table(accuracy)
        if table is None:
            continue
        for instance in distinct(table.floats("I")).tolist() if "I" in table else [None]:
            mine = stated
            if instance is not None and stated is not None and "I" in stated:
                mine = raw.table(accuracy, lambda t, i=instance: np.asarray(t.floats("I") == i))  # type: ignore[misc]
            own = table if instance is None else table.only(np.asarray(table.floats("I") == instance))
            found.append((replace(own, name="GPS"), mine))
    return found


def _in_order(parts: list[MessageTable]) -> MessageTable:
    """One table of messages of several receivers, in the order of the file."""
    if len(parts) == 1:
        return parts[0]
    table = joined_tables(parts)
    order = np.argsort(table.place, kind="stable")
    return replace(
        table,
        place=table.place[order],
        record_time_s=table.record_time_s[order],
        system=table.system[order],
        component=table.component[order],
        columns={name: column[order] for name, column in table.columns.items()},
    )
