"""Two boots in one DataFlash file are two flights: the times of later ones go on behind those of earlier ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.foundation.arrays import Floats, Ints, median
from pipeline.telemetry.clocks.boot_clock import IN_ORDER_S, UNKNOWN_BREAK_S, restarts_of
from pipeline.telemetry.clocks.clock_model import settled
from pipeline.telemetry.clocks.leaps import leaps_of, other_boots
from pipeline.telemetry.dataflash.tables import clock_field
from pipeline.telemetry.dataflash.utc import utc_readings
from pipeline.telemetry.log.tables import MessageTable, RawLog


def continued(raw: RawLog) -> RawLog:
    """The same messages with times that go on over every boot, and a note for each."""
    places, times = _readings(raw)
    restart = restarts_of(times)
    small = [i for i in restarts_of(times, IN_ORDER_S).tolist() if i not in restart and _falls(raw, int(places[i]))]
    restart = np.sort(np.concatenate([restart, np.array(small, dtype=np.int64)]))
    told = other_boots(times, _utc_beside(raw, places), restart)
    restart = np.sort(np.concatenate([restart, np.array([i for i, anew in told.items() if anew], dtype=np.int64)]))
    raw = replace(raw, notes=(*raw.notes, *_untold(raw, places, times, {*told, *restart.tolist()})))
    if not len(restart):
        return raw
    begins = places[restart]
    boot_of = np.searchsorted(begins, places, side="right")
    utc_late = _utc_late(raw, begins)
    offsets, notes, end = [0.0], [], -np.inf
    for boot in range(len(restart) + 1):
        own = times[boot_of == boot]
        if boot:
            known = utc_late[boot] - utc_late[boot - 1] + offsets[-1]
            by_gps = bool(np.isfinite(known)) and own.min() + known > end
            offsets.append(float(known) if by_gps else end + UNKNOWN_BREAK_S - float(own.min()))
            how = "by GPS time" if by_gps else "an hour after what came before as far as anyone knows"
            notes.append(
                f"the vehicle started anew at log time {own.min() + offsets[-1]:.1f} s, {how}; from there log time is"
                f" its boot time + {offsets[-1]:.1f} s"
            )
        end = max(end, float(own.max()) + offsets[-1])
    shift = np.array(offsets)
    tables = {name: _moved(table, shift[np.searchsorted(begins, table.place, side="right")])
              for name, table in raw.tables.items()}  # fmt: skip
    return replace(raw, tables=tables, notes=(*raw.notes, *notes))


def _utc_beside(raw: RawLog, places: Ints) -> Floats:
    """UTC of the receiver's messages at places (n,), NaN at all others and without a fix."""
    found = np.full(len(places), np.nan)
    table, _, utc = utc_readings(raw)
    if table is not None:
        at = np.minimum(np.searchsorted(places, table.place), max(0, len(places) - 1))
        mine = places[at] == table.place
        found[at[mine]] = utc[mine]
    return found


def _untold(raw: RawLog, places: Ints, times: Floats, told: set[int]) -> list[str]:
    """What to say of logs joined in one file whose clocks leap where no GPS time tells whether the vehicle was off."""
    leaps = np.array([i for i in leaps_of(times).tolist() if i not in told], dtype=np.int64)
    notes = []
    for head in raw.heads:
        near = leaps[(places[leaps] > head) & (places[np.maximum(leaps - 1, 0)] < head)]
        notes += [
            f"another log begins in the file at log time {times[i]:.1f} s, {times[i] - times[i - 1]:.1f} s after what"
            " came before by its own clock: no GPS time tells whether the vehicle started anew between, and it is read"
            " as if it had not"
            for i in near.tolist()
        ]
    return notes


def _readings(raw: RawLog) -> tuple[Ints, Floats]:
    """Places and boot times of all messages that carry one, in the order of the file, wild ones left out."""
    told = [
        (t.place, t.floats(field) / scale) for t in raw.tables.values() for field, scale in [clock_field(t)] if field
    ]
    if not told:
        return np.empty(0, np.int64), np.empty(0)
    place, time = (np.concatenate(part) for part in zip(*told, strict=True))
    order = np.argsort(place, kind="stable")
    time = settled(time[order])
    good = np.isfinite(time)
    return place[order][good], time[good]


def _falls(raw: RawLog, place: int) -> bool:
    """Whether the times of one kind of message fall back there: what wrote a log kind by kind did not boot anew."""
    for table in raw.tables.values():
        field, ticks = clock_field(table)
        row = int(np.searchsorted(table.place, place))
        if field and 0 < row < len(table) and table.floats(field)[row] < table.floats(field)[row - 1] - 0.1 * ticks:
            return True
    return False


def _utc_late(raw: RawLog, begins: Ints) -> Floats:
    """UTC minus boot time in each boot; NaN where no fix tells it."""
    table, time, utc = utc_readings(raw)
    found = np.full(len(begins) + 1, np.nan)
    if table is None:
        return found
    boot_of = np.searchsorted(begins, table.place, side="right")
    for boot in range(len(found)):
        late = (utc - time)[(boot_of == boot) & np.isfinite(utc - time)]
        if len(late):
            found[boot] = median(late)
    return found


def _moved(table: MessageTable, offset_s: Floats) -> MessageTable:
    field, scale = clock_field(table)
    if not field or not offset_s.any():
        return table
    return replace(table, columns={**table.columns, field: table.floats(field) + offset_s * scale})
