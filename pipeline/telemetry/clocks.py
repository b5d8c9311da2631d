"""Clocks that disagree, lie or start anew, brought onto log time.

Two clocks a, b that both run steadily: b = b0 + rate * (a - a0). Robustly: the offset is the median of b - a, pairs
further from it than the tolerance are outliers, the rest decides offset and rate by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibration.foundation.arrays import Bools, Floats, Ints
from pipeline.telemetry.flight_log import ClockFit

REBOOT_S = 10.0
"""A boot clock that falls back by more than this was started anew; less is a packet that came late."""
LARGEST_STEP_S = 60.0
UNKNOWN_BREAK_S = 3600.0
"""Log time between two boots of a vehicle where no other clock tells how long it was off."""
MAX_DRIFT = 2e-3
"""No quartz is worse; a larger slope is noise of a short log."""
EARLIEST_UTC_S = 1_104_537_600.0
"""1 January 2005: no vehicle that logs these formats flew before."""
LATEST_UTC_S = 4_102_444_800.0
"""1 January 2100."""
MOST_READINGS = 1 << 18
"""Of a boot clock, to be kept: of more, evenly chosen ones know it as well in a tenth of the memory."""
GPS_EPOCH_S = 315_964_800.0
LEAP_SECONDS = np.array(
    [46828800, 78364801, 109900802, 173059203, 252028804, 315187205, 346723206, 393984007, 425520008, 457056009,
     504489610, 551750411, 599184012, 820108813, 914803214, 1025136015, 1119744016, 1167264017],
    dtype=float,
)  # fmt: skip
"""GPS seconds at which GPS time drew one second further ahead of UTC (IERS Bulletin C; none since 2017)."""


def plausible_utc(posix_s: Floats) -> Bools:
    """True where a POSIX time can be a flight's."""
    return np.asarray((posix_s > EARLIEST_UTC_S) & (posix_s < LATEST_UTC_S))


def utc_from_gps(week: Floats, week_s: Floats) -> Floats:
    """POSIX seconds (n,) of GPS weeks and seconds of the week: GPS time minus the leap seconds since 1980."""
    gps_s = np.asarray(week, float) * 604_800.0 + np.asarray(week_s, float)
    return np.asarray(GPS_EPOCH_S + gps_s - np.searchsorted(LEAP_SECONDS, gps_s, side="right"))


def settled(time_s: Floats) -> Floats:
    """Times (n,) of messages in the order of the file, NaN where a time is a minute off from all around it."""
    if len(time_s) < 5:
        return time_s
    sevens = np.lib.stride_tricks.sliding_window_view(np.pad(time_s, 3, mode="edge"), 7)
    around = np.partition(sevens, 3, axis=1)[:, 3]
    return np.where(np.abs(time_s - around) < LARGEST_STEP_S, time_s, np.nan)


def fit_clock(
    source: str, log_s: Floats, other_s: Floats, *, tolerance_s: float = 1.0, floor_s: float = 0.0
) -> ClockFit | None:
    """The `other` clock against log time from pairs of readings (n,); None where no majority of them agrees.

    `tolerance_s` separates readings from lies; `floor_s` is the least sigma that the source deserves.
    """
    use = np.isfinite(log_s) & np.isfinite(other_s)
    if not use.any():
        return None
    log, other = (log_s, other_s) if use.all() else (log_s[use], other_s[use])
    log_epoch, epoch = float(np.median(log)), float(np.median(other))
    since = log - log_epoch
    late = other - epoch - since
    offset, rate = float(np.median(late)), 1.0
    good = np.abs(late - offset) < tolerance_s + MAX_DRIFT * np.abs(since)
    if 2 * good.sum() <= len(good):
        return None
    if not good.all():
        since, late = since[good], late[good]
    if len(late) >= 10 and np.ptp(since) > 30.0:
        centred = since - since.mean()
        slope = float(centred @ late / (centred @ centred))
        rate = 1.0 + slope if abs(slope) < MAX_DRIFT else 1.0
    late -= (rate - 1.0) * since
    offset = float(np.median(late))
    scatter = 1.4826 * float(np.median(np.abs(late - offset)))
    return ClockFit(
        source=source,
        epoch_s=epoch + offset,
        log_epoch_s=log_epoch,
        rate=rate,
        sigma_s=max(scatter, floor_s),
        pairs=len(late),
        outliers=len(good) - len(late),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class BootClock:
    """Log time of everything in a file, from the messages that carry the vehicle's boot time.

    place, log_s     (n,) readings in the order of the file, of very many a part
    restart_place    (r,) places from which the vehicle's clock had started anew
    shift_s          (r + 1,) log time minus boot time in each stretch
    record           the recorder's clock against log time, None where it has none
    """

    place: Ints
    log_s: Floats
    restart_place: Ints
    shift_s: Floats
    record: ClockFit | None

    def of_boot_time(self, place: Ints, boot_s: Floats) -> Floats:
        """Log time (n,) of boot times read at places in the file."""
        return np.asarray(boot_s + self.shift_s[np.searchsorted(self.restart_place, place, side="right")])

    def of_record(self, place: Ints, record_s: Floats) -> Floats:
        """Log time (n,) of messages that carry none: the recorder's clock, where its neighbours confirm it."""
        if len(self.log_s) == 0:
            return np.full(len(place), np.nan)
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
        shift = float(np.median(late[np.isfinite(late)])) if np.isfinite(late).any() else 0.0
        return (time, 0.0) if abs(shift) < 1.0 else (time + shift, shift)


def boot_clock(place: Ints, boot_s: Floats, record_s: Floats) -> BootClock:
    """The clock of a file from (n,) boot times and the recorder's times beside them, in the order of the file."""
    restart = restarts_of(boot_s)
    bounds = [*restart.tolist(), len(boot_s)]
    shift = [0.0]
    log = np.array(boot_s, float)
    for first, stop in pairwise(bounds):
        previous = slice(0, first)
        shift.append(_shift_after(log[previous], record_s[previous], boot_s[first:stop], record_s[first:stop]))
        log[first:stop] += shift[-1]
    few = slice(None, None, 1 + len(log) // MOST_READINGS)
    record = fit_clock("recorder", log[few], record_s[few], tolerance_s=2.0)
    return BootClock(
        place=place[few].copy(),
        log_s=np.maximum.accumulate(log)[few].copy() if len(log) else log,
        restart_place=place[restart],
        shift_s=np.array(shift),
        record=record,
    )


def restarts_of(boot_s: Floats) -> Ints:
    """Indices at which the clock started anew: it falls back, and what follows stays back."""
    found = []
    top, i = -np.inf, 0
    falls = np.flatnonzero(np.diff(boot_s, prepend=boot_s[:1]) < -REBOOT_S) if len(boot_s) else np.empty(0, int)
    for fall in falls.tolist():
        top = max(top, float(boot_s[i:fall].max())) if fall > i else top
        ahead = boot_s[fall : fall + 5]
        if np.median(ahead) < top - REBOOT_S:
            found.append(fall)
            top, i = -np.inf, fall
    return np.array(found, dtype=np.int64)


def _shift_after(log_before: Floats, record_before: Floats, boot_after: Floats, record_after: Floats) -> float:
    """Log time minus boot time after a restart: by the recorder's clock, else an hour's break."""
    end = float(log_before.max())
    late = np.median(record_after - boot_after) - np.median(record_before - log_before)
    if np.isfinite(late) and boot_after.min() + late > end:
        return float(late)
    return end + UNKNOWN_BREAK_S - float(boot_after.min())
