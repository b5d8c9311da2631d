"""Read any flight log: the file's kind is told by its first bytes and its name.

What reads one format is imported where a log of it is read: all of them take a quarter of a second.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calibration.foundation.compiled import AVAILABLE
from calibration.foundation.errors import InputFileError
from pipeline.telemetry.clocks.own_clock import with_clock_notes
from pipeline.telemetry.log.flight_log import FlightLog, LogFormat
from pipeline.telemetry.log.mapped_file import mapped
from pipeline.telemetry.log.tables import Progress, RawLog
from pipeline.telemetry.log.validity import with_validity_notes

if TYPE_CHECKING:
    from pipeline.telemetry.excerpts.excerpt import Excerpt, PieceReader

KNOWN = ".tlog, .mavlink, .bin, .log, .ulg, .srt, .ts with metadata, .csv of AirData or DJI"
MAVLINK_NAMES: dict[str, LogFormat] = {".tlog": "tlog", ".mavlink": "mavlink", ".mav": "mavlink"}
HEADS: dict[LogFormat, bytes] = {"ulog": b"ULog", "dataflash": b"\xa3\x95"}
NAMES: dict[str, LogFormat] = {".ulg": "ulog", ".bin": "dataflash", ".srt": "dji srt", ".log": "dataflash text"}


def read_log(
    path: Path,
    *,
    system: int | None = None,
    gimbal: int | None = None,
    dialect: str = "",
    excerpts: tuple[Excerpt, ...] = (),
    progress: Progress = None,
) -> FlightLog:
    """The flight log at `path`.

    With `excerpts` at least they are in it whole, and of the rest a sample, where the format (`.tlog` by the fast
    reader, binary DataFlash) and the log (`read_excerpts`) allow; else everything is.
    `system` picks one vehicle of a MAVLink link by its system id, `gimbal` one gimbal of a vehicle: by its device or
    component, in DataFlash and PX4 logs by its instance. `dialect` names a pymavlink dialect or a file of
    message definitions (.xml) for MAVLink; "" is ardupilotmega, with the common messages, by the fast reader.
    `progress` is called with the share done, 0 to 1.

    Raises InputFileError where the file is missing, of no known kind, or holds no vehicle, UsageError where there is no
    such dialect.
    """
    return with_validity_notes(with_clock_notes(_read(path, system, gimbal, dialect, excerpts, progress)))


def _read(
    path: Path, system: int | None, gimbal: int | None, dialect: str, excerpts: tuple[Excerpt, ...], progress: Progress
) -> FlightLog:
    kind = log_format(path)
    if excerpts:
        from pipeline.telemetry.excerpts.excerpt import read_excerpts

        reader = _piece_reader(path, kind, system, gimbal, dialect)
        excerpt = None if reader is None else read_excerpts(reader, excerpts)
        if excerpt is not None:
            return excerpt
    match kind:
        case "tlog" | "mavlink":
            from pipeline.telemetry.mavlink.flight import mavlink_flight

            return mavlink_flight(read_mavlink(path, dialect=dialect, progress=progress), system=system, gimbal=gimbal)
        case "dataflash" | "dataflash text":
            from pipeline.telemetry.dataflash.flight import dataflash_flight
            from pipeline.telemetry.dataflash.messages.read import read_dataflash, read_dataflash_text

            raw = (read_dataflash if kind == "dataflash" else read_dataflash_text)(path, progress=progress)
            return dataflash_flight(raw, gimbal=gimbal)
        case "ulog":
            from pipeline.telemetry.ulog.flight import read_ulog

            return read_ulog(path, gimbal=gimbal, progress=progress)
        case "dji srt":
            from pipeline.telemetry.subtitles.dji import read_dji_srt

            return read_dji_srt(path, progress=progress)
        case "flight record":
            from pipeline.telemetry.flight_records.flight import read_flight_record

            return read_flight_record(path, progress=progress)
        case "misb klv":
            from pipeline.telemetry.klv.flight import read_klv

            return read_klv(path, system=system, progress=progress)


def log_format(path: Path) -> LogFormat:
    """What kind of log a file is: by its name where MAVLink's is meant, which begins with anything, else by its head.

    Raises InputFileError where the file is missing, empty, or of no known kind.
    """
    kind, data = path.suffix.lower(), mapped(path, expected="a flight log")
    head = bytes(data[:4])
    if kind in MAVLINK_NAMES:
        return MAVLINK_NAMES[kind]
    for known, begin in HEADS.items():
        if head.startswith(begin):
            return known
    from pipeline.telemetry.flight_records.flight import is_flight_record
    from pipeline.telemetry.klv.transport import is_transport
    from pipeline.telemetry.subtitles.in_video import VIDEO_NAMES

    if is_transport(data):
        return "misb klv"
    if kind in VIDEO_NAMES:
        return "dji srt"
    if is_flight_record(path):
        return "flight record"
    if kind in NAMES:
        return NAMES[kind]
    raise InputFileError(
        where=str(path),
        seen=f"a file named {kind or 'without ending'}",
        expected=f"a flight log: {KNOWN}",
        advice="convert it, or give the camera's poses as a .csv",
    )


def _piece_reader(
    path: Path, kind: LogFormat, system: int | None, gimbal: int | None, dialect: str
) -> PieceReader | None:
    """How the log is read in pieces; None where its format never is."""
    from pipeline.telemetry.excerpts.formats import dataflash_pieces, tlog_pieces

    if kind == "tlog" and AVAILABLE and not dialect:
        return tlog_pieces(path, system=system, gimbal=gimbal)
    return dataflash_pieces(path, gimbal=gimbal) if kind == "dataflash" else None


def read_mavlink(path: Path, *, dialect: str = "", progress: Progress = None) -> RawLog:
    """A MAVLink log, by the compiled reader where numba is installed, else, or in another dialect, by pymavlink's."""
    if AVAILABLE and not dialect:
        from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
        from pipeline.telemetry.mavlink.packets.names import FIELDS

        return read_mavlink_fast(path, fields=FIELDS, progress=progress)
    from pipeline.telemetry.mavlink.packets.plain import read_mavlink_plain

    return read_mavlink_plain(path, dialect=dialect, progress=progress)
