"""Which vehicle of a MAVLink link the log is read for: its messages and its clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.foundation.arrays import Floats, Ints
from calibration.foundation.errors import InputFileError
from pipeline.telemetry.clocks.boot_clock import BootClock
from pipeline.telemetry.clocks.utc import plausible_utc
from pipeline.telemetry.log.tables import MessageTable, RawLog

GPS_MESSAGES = ("GPS_RAW_INT", "GPS2_RAW")
POSITION_MESSAGES = ("GLOBAL_POSITION_INT", *GPS_MESSAGES, "AHRS2")
BOOT_MESSAGES = ("ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "SYSTEM_TIME")
NO_AUTOPILOT, GROUND_STATION = 8, 6
"""MAV_AUTOPILOT_INVALID of a heartbeat's `autopilot`, MAV_TYPE_GCS of its `type`."""
BOOT_ROUND_S, OVER_S = (1 << 32) / 1000, 5.0
"""After 49.7 days milliseconds since boot begin anew, at the moment itself."""
AUTOPILOT_NAMES = {3: "ArduPilot", 12: "PX4"}
"""MAV_AUTOPILOT of those whose own gimbal messages are known to say one thing and mean another."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """One vehicle's messages and its clock."""

    raw: RawLog
    system: int
    component: int
    clock: BootClock

    @property
    def autopilot(self) -> int:
        """What the autopilot says that it is (MAV_AUTOPILOT); -1 where it does not."""
        table = self.own("HEARTBEAT")
        return -1 if table is None else int(np.median(table.floats("autopilot")))

    def parameter(self, name: str) -> float | None:
        """A parameter of the autopilot as it was sent last; None where it was not, or is no number."""
        table = self.own("PARAM_VALUE")
        if table is None:
            return None
        mine = np.flatnonzero([_text(value) == name for value in table.columns["param_id"].tolist()])
        value = float(table.floats("param_value")[mine[-1]]) if len(mine) else np.nan
        return value if np.isfinite(value) else None

    def own(self, name: str) -> MessageTable | None:
        """Messages of the autopilot itself."""
        return self.raw.table(name, lambda t: (t.system == self.system) & (t.component == self.component))

    def any(self, name: str) -> MessageTable | None:
        """Messages of every component of the vehicle."""
        return self.raw.table(name, lambda t: np.asarray(t.system == self.system))


def _text(value: object) -> str:
    raw = value.encode() if isinstance(value, str) else value
    return bytes(raw).split(b"\0")[0].decode("ascii", "replace") if isinstance(raw, bytes) else ""


def choose_vehicle(raw: RawLog, system: int | None) -> tuple[tuple[int, int], list[str]]:
    """System and component of the autopilot, and what to say about the choice."""
    votes = votes_of(raw, system)
    if not votes:
        whom = "an autopilot" if system is None else f"system {system}"
        raise InputFileError(
            where=str(raw.path),
            seen=f"no position, attitude or heartbeat of {whom} among {sum(raw.counts.values())} messages"
            f" ({raw.corrupt_packets} corrupt packets)",
            expected="a MAVLink log of a vehicle",
            advice="check that it is the telemetry log of the flight"
            + ("" if system is None else f"; systems in it: {sorted({who[0] for who in votes_of(raw)})}"),
        )
    best = max(votes, key=lambda who: (votes[who], -who[0], -who[1]))
    others = sorted({who[0] for who in votes} - {best[0]})
    said = f"vehicles {', '.join(map(str, others))} are in the log too; system {best[0]} has the most positions"
    return best, [said] if others else []


def systems_of(raw: RawLog) -> tuple[int, ...]:
    """Every vehicle that gives positions."""
    return tuple(sorted({who[0] for who, n in votes_of(raw).items() if n[0] >= 2}))


def votes_of(raw: RawLog, system: int | None = None) -> dict[tuple[int, int], tuple[int, int, int]]:
    """(system, component) -> how many positions, attitudes and heartbeats it sent, of autopilots.

    An autopilot is what its heartbeat says it is; where none says so, whoever is not said to be something else.
    """
    votes: dict[tuple[int, int], list[int]] = {}
    groups = (POSITION_MESSAGES, ("ATTITUDE", "ATTITUDE_QUATERNION"), ("HEARTBEAT",))
    autopilots, others = _heartbeats(raw)
    for slot, names in enumerate(groups):
        for name in names:
            table = raw.table(name)
            if table is None:
                continue
            many = np.bincount(table.system.astype(np.int64) << 8 | table.component)
            for who in np.flatnonzero(many).tolist():
                votes.setdefault((who >> 8, who & 255), [0, 0, 0])[slot] += int(many[who])
    found = {who: (n[0], n[1], n[2]) for who, n in votes.items() if system in (None, who[0])}
    said = {who: n for who, n in found.items() if who in autopilots}
    return said or {who: n for who, n in found.items() if who not in others}


def autopilots_of(raw: RawLog) -> set[int]:
    """The systems that have an autopilot, by its heartbeat."""
    return {system for system, _ in _heartbeats(raw)[0]}


def _heartbeats(raw: RawLog) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Who says that it is an autopilot, and who says that it is something else: by most of its heartbeats."""
    table = raw.table("HEARTBEAT")
    if table is None:
        return set(), set()
    pilot = (table.floats("autopilot") != NO_AUTOPILOT) & (table.floats("type") != GROUND_STATION)
    code = table.system.astype(np.int64) << 8 | table.component
    yes, all_of = np.bincount(code, weights=pilot), np.bincount(code)
    names = {int(c): (int(c) >> 8, int(c) & 255) for c in np.flatnonzero(all_of)}
    autopilots = {who for c, who in names.items() if 2 * yes[c] > all_of[c]}
    return autopilots, set(names.values()) - autopilots


def boot_readings(raw: RawLog, chosen: tuple[int, int]) -> tuple[Ints, Floats, Floats]:
    """Places, boot times and the recorder's times beside them, each (n,), in the order of the file."""
    asked = (raw.table(name, lambda t: (t.system == chosen[0]) & (t.component == chosen[1])) for name in BOOT_MESSAGES)
    found = [table for table in asked if table is not None]
    if not found:
        return np.empty(0, np.int64), np.empty(0), np.empty(0)
    place = np.concatenate([table.place for table in found])
    order = np.argsort(place, kind="stable")
    boot_s, record_s = (
        np.concatenate(columns)[order]
        for columns in ([t.floats("time_boot_ms") / 1000 for t in found], [t.record_time_s for t in found])
    )
    return place[order], boot_s, record_s


def unix_readings(raw: RawLog, chosen: tuple[int, int], place: Ints) -> Floats:
    """The vehicle's UTC at places (n,), those of `boot_readings`; NaN where it tells none, or one of no flight."""
    found = np.full(len(place), np.nan)
    table = raw.table("SYSTEM_TIME", lambda t: (t.system == chosen[0]) & (t.component == chosen[1]))
    if table is not None:
        unix = table.floats("time_unix_usec") * 1e-6
        found[np.searchsorted(place, table.place)] = np.where(plausible_utc(unix), unix, np.nan)
    return found


def clock_notes(clock: BootClock) -> list[str]:
    """One sentence for each start anew of the vehicle, and for a recorder's clock that lies."""
    if not len(clock.log_s):
        return ["no message carries the vehicle's boot time: log time is the recorder's, in seconds since 1970"]
    notes = []
    for place, offset in zip(clock.restart_place.tolist(), clock.offset_s[1:].tolist(), strict=True):
        at = float(clock.log_s[np.searchsorted(clock.place, place)])
        over = abs(offset - BOOT_ROUND_S * round(offset / BOOT_ROUND_S)) < OVER_S <= offset
        what = "its boot clock of 32 bits ran over" if over else "the vehicle started anew"
        notes.append(f"{what} at log time {at:.1f} s; from there log time is its boot time + {offset:.1f} s")
    if clock.record is not None and clock.record.outliers > 0:
        notes.append(
            f"{clock.record.outliers} of the recorder's timestamps disagree with the vehicle's clock and are not used"
        )
    return notes
