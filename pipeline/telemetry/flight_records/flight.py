"""From a flight record (.csv) to a FlightLog.

Log time is seconds since the record's first row. AirData's dates are UTC in whole seconds: the moments at which they
tick tell it to a row. Other dates are local, of no known zone. Where the flag "recording" is raised, a video began.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from calibration.foundation.arrays import Floats
from calibration.foundation.errors import InputFileError
from calibration.foundation.files import read_bytes
from pipeline.geometry import rotation
from pipeline.telemetry.clocks.boot_clock import another_recording, continued
from pipeline.telemetry.clocks.clock_model import fit_clock
from pipeline.telemetry.flight_records.header import Header, check_units, header_of
from pipeline.telemetry.gimbals.still_heading import still_heading
from pipeline.telemetry.heights.dji import RECEIVER_SIGMA_M, dji_heights
from pipeline.telemetry.log.flight_log import (
    EARTH,
    Accuracy,
    AttitudeSeries,
    ClockModel,
    FlightLog,
    GimbalSeries,
    PositionSeries,
)
from pipeline.telemetry.log.series import attitude_series, gimbal_series, interval_s, position_series
from pipeline.telemetry.log.tables import Progress

HEADER_WITHIN = 1 << 16
DAY_S = 86_400.0
RECORDING_LAG_S = 0.3
"""The app learns that the camera records up to half a second late."""
UTC_FLOOR_S = 0.05
CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:\.\d+)?)\s*([AaPp][Mm])?\s*(?:Z|[+-]00:?00)?$")
DATE = re.compile(r"(\d{4})[-/](\d{1,2})[-/](\d{1,2})|(\d{1,2})/(\d{1,2})/(\d{4})")
NO = frozenset(("", "0", "false", "no", "null"))
DENIED = NO - {""}
"""What a flag says that denies; one that says nothing does not."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The rows of a record, by column."""

    header: Header
    cells: tuple[tuple[str, ...], ...]

    def text(self, what: str) -> list[str]:
        """A column as it is written; empty where there is none."""
        column = self.header.columns.get(what)
        if column is None:
            return [""] * len(self.cells)
        return [row[column.place].strip() if column.place < len(row) else "" for row in self.cells]

    def numbers(self, what: str) -> Floats:
        """A column (n,) in SI or degrees; NaN where it says nothing."""
        column = self.header.columns.get(what)
        scale = 1.0 if column is None else column.scale
        comma = self.header.delimiter != ","  # then it may part decimals
        cells = (cell.replace(",", ".") if comma else cell for cell in self.text(what))
        return np.array([_number(cell) for cell in cells], float) * scale


def is_flight_record(path: Path) -> bool:
    """Whether a `.csv` is a flight record, by its header."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    with path.open("rb") as file:
        return _header(_text(file.read(HEADER_WITHIN))) is not None


def read_flight_record(path: Path, *, progress: Progress = None) -> FlightLog:
    """The flight in a flight record. Raises InputFileError where it is none, or its units are not known."""
    found = _header(_text(read_bytes(path, expected="a flight record (.csv)")))
    if found is None:
        raise InputFileError(
            where=str(path),
            seen="no header of AirData or DJI",
            expected="a flight record (.csv)",
            advice="export it again",
        )
    header, lines = found
    check_units(header, path)
    rows = Rows(
        header=header, cells=tuple(tuple(row) for row in csv.reader(lines, delimiter=header.delimiter) if any(row))
    )
    time, utc, time_notes = _times(rows)
    if not np.isfinite(time).any():
        raise InputFileError(
            where=str(path),
            seen="no row with a time",
            expected="time(millisecond), or CUSTOM.updateTime, or OSD.flyTime [s]",
            advice="export the record again with its times",
        )
    position, accuracy, height_notes = _position(rows, time)
    events, event_notes = _recordings(rows, time)
    attitude, gimbal = _attitude(rows, time), _gimbal(rows, time)
    if progress is not None:
        progress(1.0)
    return FlightLog(
        path=path,
        format="flight record",
        counts={header.dialect: len(rows.cells)},
        position=position,
        attitude=attitude,
        gimbal=gimbal,
        camera_event_s=events,
        camera_event_source="isVideo" if len(events) else "",
        camera_event_sigma_s=RECORDING_LAG_S if len(events) else 0.0,
        utc=utc,
        accuracy=accuracy,
        notes=(*time_notes, *event_notes, *height_notes, *still_heading(gimbal, attitude)),
    )


def _text(raw: bytes) -> str:
    raw = raw.replace(b"\0", b"")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _header(text: str) -> tuple[Header, io.StringIO] | None:
    """The header, and the lines behind it; a first line "sep=," is no header."""
    lines = io.StringIO(text, newline="")
    for _ in range(2):
        first = lines.readline()
        header = header_of(first)
        if header is not None:
            return header, lines
        if not first.lower().startswith("sep="):
            return None
    return None


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _times(rows: Rows) -> tuple[Floats, ClockModel | None, tuple[str, ...]]:
    """Log time (n,), UTC and notes."""
    zone = rows.header.columns["clock"].unit if "clock" in rows.header.columns else ""
    stamps = np.array([_stamp(date, clock) for date, clock in zip(rows.text("date"), rows.text("clock"), strict=True)])
    if zone == "epoch":  # milliseconds since 1970
        stamps = np.array([_number(cell) for cell in rows.text("clock")]) / 1000
    airdata = rows.header.dialect == "airdata"
    own = airdata or np.isfinite(stamps).sum() < 2
    time, parts = continued(rows.numbers("time") if own else _past_midnight(stamps), stamps)
    time = time - np.nanmin(time, initial=np.inf)
    notes = tuple(another_recording(offset) for _, offset in parts)
    if airdata:
        return time, _ticking(time, stamps), notes
    if zone in ("utc", "epoch") and np.nanmedian(stamps) > DAY_S:
        return time, fit_clock("CUSTOM.updateTime", time, stamps, floor_s=UTC_FLOOR_S), notes
    said = "dates in the record are local, of an unknown time zone: it does not know UTC"
    return time, None, (*notes, said)


def _stamp(date: str, clock: str) -> float:
    """Seconds since 1970 of a date and a time of day, in one cell or two; of the day where there is no date."""
    found, day = CLOCK.search(clock), DATE.search(date or clock)
    if found is None:
        return float("nan")
    hours, minutes, seconds = int(found[1]), int(found[2]), float(found[3])
    if found[4]:
        hours = hours % 12 + (12 if found[4].lower() == "pm" else 0)
    since = hours * 3600 + minutes * 60 + seconds
    if day is None:
        return since
    year, month, of_month = (int(day[i]) for i in ((1, 2, 3) if day[1] else (6, 4, 5)))
    if month > 12:
        month, of_month = of_month, month
    try:
        return datetime(year, month, of_month, tzinfo=UTC).timestamp() + since
    except ValueError:
        return float("nan")


def _past_midnight(stamp_s: Floats) -> Floats:
    """Times of day (n,) that go on past midnight."""
    known = np.flatnonzero(np.isfinite(stamp_s))
    falls = np.diff(stamp_s[known]) < -DAY_S / 2
    late = np.zeros(len(stamp_s))
    late[known[1:]] = DAY_S * np.cumsum(falls)
    return stamp_s + late


def _ticking(time_s: Floats, stamp_s: Floats) -> ClockModel | None:
    """UTC by whole seconds: right, to half a row, where one becomes the next."""
    known = np.isfinite(time_s + stamp_s)
    time, stamp = time_s[known], stamp_s[known]
    if len(time) and np.all(stamp % 1 == 0):
        ticks = np.flatnonzero(np.diff(stamp) == 1) + 1
        if len(ticks) < 2:
            return None
        return fit_clock(
            "datetime(utc)", (time[ticks] + time[ticks - 1]) / 2, stamp[ticks], floor_s=interval_s(time) / np.sqrt(12)
        )
    return fit_clock("datetime(utc)", time, stamp, floor_s=UTC_FLOOR_S)


def _position(rows: Rows, time_s: Floats) -> tuple[PositionSeries | None, Accuracy, tuple[str, ...]]:
    lat, lon = rows.numbers("lat"), rows.numbers("lon")
    nowhere = ((lat == 0) & (lon == 0)) | np.array([cell.lower() in DENIED for cell in rows.text("fixed")])
    lat, lon = (np.where(nowhere, np.nan, angle) for angle in (lat, lon))
    if not np.isfinite(lat + lon).any():
        return None, Accuracy(), ()
    above_home = rows.numbers("above_home")
    heights = dji_heights(rows.numbers("above_sea"), above_home, lat, lon)
    series = position_series(
        source="flight record", datum=heights.datum, height_from=heights.words, time_s=time_s, lat_deg=lat, lon_deg=lon,
        height_m=heights.height_m, velocity_ned_mps=np.full((len(lat), 3), np.nan), above_home_m=above_home,
    )  # fmt: skip
    stated = Accuracy(horizontal_m=RECEIVER_SIGMA_M, vertical_m=heights.sigma_m, source=f"DJI's {heights.words}")
    return series, stated, heights.notes


def _attitude(rows: Rows, time_s: Floats) -> AttitudeSeries | None:
    yaw, pitch, roll = (np.radians(rows.numbers(what)) for what in ("yaw", "pitch", "roll"))
    if not np.isfinite(yaw + pitch + roll).any():
        return None
    return attitude_series(source="flight record", time_s=time_s, ned_from_body=rotation.ned_from_frd(yaw, pitch, roll))


def _gimbal(rows: Rows, time_s: Floats) -> GimbalSeries | None:
    """Against north and the horizon; its roll is zero where the record never gives it."""
    yaw, pitch, roll = (np.radians(rows.numbers(f"gimbal_{what}")) for what in ("yaw", "pitch", "roll"))
    if not np.isfinite(roll).any():
        roll = np.zeros(len(roll))
    if not np.isfinite(yaw + pitch + roll).any():
        return None
    q = rotation.ned_from_frd(yaw, pitch, roll)
    return gimbal_series(source="flight record", time_s=time_s, attitude=q, frame=np.full(len(q), EARTH))


def _recordings(rows: Rows, time_s: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Log times (k,) at which recording began, between two rows, and notes."""
    flag = np.array([cell.lower() not in NO for cell in rows.text("video")])
    raised = np.flatnonzero(flag[1:] & ~flag[:-1]) + 1 if len(flag) else np.empty(0, np.int64)
    event = (time_s[raised] + time_s[raised - 1]) / 2
    event = event[np.isfinite(event)]
    notes = []
    if len(flag) and flag[0]:
        notes.append("the record begins while a video is recorded: when that began is not in it")
    if len(event) > 1 or notes:
        told = ", ".join(f"{t:.1f}" for t in event[:8].tolist()) + (" ..." if len(event) > 8 else "")
        if len(event):
            notes.append(f'recordings begin at log time {told} s; "camera-event" is the first of them')
    return event, tuple(notes)
