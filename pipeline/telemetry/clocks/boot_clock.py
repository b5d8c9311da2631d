"""The vehicle's boot clock, which starts anew with every boot, brought onto log time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.foundation.arrays import Floats, Ints, median
from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.clocks.leaps import begun_anew, other_boots
from pipeline.telemetry.log.flight_log import ClockModel

REBOOT_S = 10.0
"""A boot clock that falls back by more than this was started anew; less may be packets that came late."""
IN_ORDER_S = 1.0
"""The same of rows that a file holds in their order; of packets where more bears it out (`_small_restarts`)."""
AROUND_S, LATE_SHARE = 20.0, 0.8
"""A start anew makes a boot clock late for good, by what it falls back and more: held against the most punctual of the
readings this long on both sides, in this share of the fall."""
OFF_S = 1.0
"""No autopilot is up again sooner."""
MOST_SMALL = 10_000
"""Falls back that are looked at: two links that tell of one vehicle by turns make one at every turn."""
UNKNOWN_BREAK_S = 3600.0
"""Log time between two boots of a vehicle where no other clock tells how long it was off."""
MOST_READINGS = 1 << 18
"""Of a boot clock, to be kept: of more, evenly chosen ones know it as well in a tenth of the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BootClock:
    """Log time of everything in a file, from the messages that carry the vehicle's boot time.

    place, log_s     (n,) readings in the order of the file, of very many a part
    restart_place    (r,) places from which the vehicle's clock had started anew
    offset_s         (r + 1,) log time minus boot time of each boot
    record           the recorder's clock against log time, None where it has none
    """

    place: Ints
    log_s: Floats
    restart_place: Ints
    offset_s: Floats
    record: ClockModel | None

    def of_boot_time(self, place: Ints, boot_s: Floats) -> Floats:
        """Log time (n,) of boot times read at places in the file."""
        return np.asarray(boot_s + self.offset_s[np.searchsorted(self.restart_place, place, side="right")])

    def of_record(self, place: Ints, record_s: Floats) -> Floats:
        """Log time (n,) of messages that carry none: the recorder's clock, where its neighbours confirm it.

        Where no message carries a boot time the recorder's clock is log time.
        """
        if len(self.log_s) == 0:
            return np.asarray(record_s)
        by_place = np.interp(place, self.place, self.log_s)
        if self.record is None:
            return np.asarray(by_place)
        by_record = self.record.log_epoch_s + (record_s - self.record.epoch_s) / self.record.rate
        return np.where(np.abs(by_record - by_place) < 1.0, by_record, by_place)

    def of_other_boot_time(self, place: Ints, record_s: Floats, boot_s: Floats) -> tuple[Floats, float]:
        """Log time (n,) of another component's boot times, and the seconds by which its clock was moved.

        A component on the vehicle's own clock (within a second of it, the link's delay) is left as it is.
        """
        time, arrived = self.of_boot_time(place, boot_s), self.of_record(place, record_s)
        late = arrived - time
        offset = median(late[np.isfinite(late)]) if np.isfinite(late).any() else 0.0
        return (time, 0.0) if abs(offset) < 1.0 else (time + offset, offset)


def boot_clock(place: Ints, boot_s: Floats, record_s: Floats, unix_s: Floats | None = None) -> BootClock:
    """The clock of a file from (n,) boot times and the recorder's times beside them, in the order of the file.

    `unix_s` (n,) is the vehicle's UTC, NaN where no message tells it.
    """
    unix = np.full(len(boot_s), np.nan) if unix_s is None else unix_s
    restart = restarts_of(boot_s)
    restart = np.sort(np.concatenate([restart, _small_restarts(boot_s, record_s, restart)]))
    restart = np.sort(np.concatenate([restart, begun_anew(boot_s, record_s, unix, restart)]))
    bounds = [*restart.tolist(), len(boot_s)]
    other = record_s if np.isfinite(record_s).any() else unix
    offset = [0.0]
    log = np.array(boot_s, float)
    for first, stop in pairwise(bounds):
        previous = slice(0, first)
        offset.append(_offset_after(log[previous], other[previous], boot_s[first:stop], other[first:stop]))
        log[first:stop] += offset[-1]
    few = slice(None, None, 1 + len(log) // MOST_READINGS)
    record = fit_clock("recorder", log[few], record_s[few], tolerance_s=2.0)
    return BootClock(
        place=place[few].copy(),
        log_s=np.maximum.accumulate(log)[few].copy() if len(log) else log,
        restart_place=place[restart],
        offset_s=np.array(offset),
        record=record,
    )


def restarts_of(boot_s: Floats, least_s: float = REBOOT_S) -> Ints:
    """Indices at which the clock (n,) started anew: it falls back by more than `least_s`, and what follows stays back.

    Rows that come seldom pass what was before in a few of them: they go on from where it fell to, at their own rate.
    """
    found = []
    top, i = -np.inf, 0
    falls = np.flatnonzero(np.diff(boot_s, prepend=boot_s[:1]) < -least_s) if len(boot_s) else np.empty(0, int)
    for fall in falls.tolist():
        top = max(top, float(boot_s[i:fall].max())) if fall > i else top
        ahead = boot_s[fall : fall + 5]
        if median(ahead) < top - least_s or _goes_on(boot_s[max(i, fall - 20) : fall], ahead):
            found.append(fall)
            top, i = -np.inf, fall
    return np.array(found, dtype=np.int64)


def _goes_on(before_s: Floats, ahead_s: Floats) -> bool:
    """Whether times after a fall go on from row to row as those before it did; a late row is followed by a leap."""
    steps = np.diff(before_s)
    if len(ahead_s) < 2 or not (steps > 0).any():
        return False
    after = np.diff(ahead_s)
    return bool(np.all((after > 0) & (after < 1.5 * median(steps[steps > 0]))))


def _small_restarts(boot_s: Floats, record_s: Floats, restart: Ints) -> Ints:
    """Indices at which the clock (n,) started anew by falling back by IN_ORDER_S to REBOOT_S, beside `restart`.

    Packets that came late, over another link, fall back too. After a start anew no packet is as punctual by the
    recorder's clock as before; where there is no such clock, packets that go on for good from where the clock fell to
    and do not repeat what was said are of another boot.
    """
    found: list[int] = []
    falls = np.flatnonzero(np.diff(boot_s, prepend=boot_s[:1]) < -IN_ORDER_S)[:MOST_SMALL]
    if not len(falls):
        return np.empty(0, dtype=np.int64)
    late, begin, top = record_s - boot_s, 0, np.maximum.accumulate(boot_s)
    anew = set(restart.tolist())
    for fall in sorted({*falls.tolist(), *anew}):
        by = float(top[fall - 1] - boot_s[fall]) if fall > begin else 0.0
        started = fall in anew
        if not started and IN_ORDER_S < by <= REBOOT_S:
            gap = float(record_s[fall] - record_s[fall - 1])  # NaN where there is no recorder
            again = _until_passed(boot_s[fall:], float(top[fall - 1]))
            punctual = _late_for_good(late, record_s, begin, fall, by) if np.isfinite(gap) else _climbs(again, by)
            repeats = gap < OFF_S or not np.isfinite(gap)
            if punctual and not (repeats and 2 * int(np.isin(again, boot_s[begin:fall]).sum()) >= len(again)):
                found.append(fall)
                started = True
        if started:
            begin, top = fall, top.copy()
            np.maximum.accumulate(boot_s[fall:], out=top[fall:])
    return np.array(found, dtype=np.int64)


def _until_passed(rows_s: Floats, before_s: float) -> Floats:
    """The first of times (n,) up to the one that passes what was before."""
    first, step = 0, 64
    while first < len(rows_s):
        over = rows_s[first : first + step] > before_s
        if over.any():
            return rows_s[: first + int(np.argmax(over))]
        first, step = first + step, 4 * step
    return rows_s


def _late_for_good(late_s: Floats, record_s: Floats, begin: int, fall: int, by_s: float) -> bool:
    """Whether no reading after a fall is as punctual as before it."""
    at = float(record_s[fall])
    first = begin + int(np.searchsorted(record_s[begin:fall], at - AROUND_S))
    stop = fall + int(np.searchsorted(record_s[fall:], at + 3 * AROUND_S, side="right"))
    before, after = late_s[min(first, fall - 1) : fall], late_s[fall : max(stop, fall + 1)]
    return bool(np.nanmin(after) - np.nanmin(before) >= LATE_SHARE * by_s)


def _climbs(again_s: Floats, by_s: float) -> bool:
    """Whether times after a fall climb slowly: no leap among them takes back half of it."""
    return len(again_s) > 1 and bool(np.diff(again_s).max() < 0.5 * by_s)


def continued(time_s: Floats, other_s: Floats | None = None) -> tuple[Floats, list[tuple[int, float]]]:
    """Times (n,) of several recordings in one file that go on behind each other, and where each began, with its offset.

    By another clock (n,) where both recordings have it and it goes on; else an hour later.
    """
    known = np.flatnonzero(np.isfinite(time_s))
    own = time_s[known]
    falls = restarts_of(own, IN_ORDER_S)
    leaps = [] if other_s is None else [i for i, anew in other_boots(own, other_s[known], falls).items() if anew]
    restart = known[np.sort(np.concatenate([falls, np.array(leaps, dtype=np.int64)]))].tolist()
    found, told = time_s.copy(), []
    late = np.full(len(time_s), np.nan) if other_s is None else other_s - time_s
    for first, before, stop in zip(restart, [0, *restart], [*restart[1:], len(time_s)], strict=False):
        end, begin = float(np.nanmax(found[:first])), float(np.nanmin(time_s[first:stop]))
        offset = end + UNKNOWN_BREAK_S - begin
        clocks = [part[np.isfinite(part)] for part in (late[before:first], late[first:stop])]
        if all(map(len, clocks)):
            by_other = float(median(clocks[1]) - median(clocks[0])) + float(found[before] - time_s[before])
            offset = by_other if np.isfinite(by_other) and begin + by_other > end else offset
        found[first:stop] = time_s[first:stop] + offset
        told.append((first, offset))
    return found, told


def another_recording(offset_s: float) -> str:
    """What is said of each but the first."""
    return f"another recording begins in the file: its log time is its own + {offset_s:.1f} s"


def _offset_after(log_before: Floats, other_before: Floats, boot_after: Floats, other_after: Floats) -> float:
    """Log time minus boot time after a restart: by another clock that tells both sides, else an hour's break."""
    end = float(log_before.max())
    clocks = [late[np.isfinite(late)] for late in (other_after - boot_after, other_before - log_before)]
    late = median(clocks[0]) - median(clocks[1])
    if np.isfinite(late) and boot_after.min() + late > end:
        return float(late)
    return end + UNKNOWN_BREAK_S - float(boot_after.min())
