"""Read any flight log: the file's kind is told by its first bytes and its name."""

from __future__ import annotations

from pathlib import Path

from calibration.foundation.errors import InputFileError
from pipeline.telemetry.compiled import COMPILED
from pipeline.telemetry.dataflash import read_dataflash, read_dataflash_text
from pipeline.telemetry.dataflash_poses import dataflash_flight
from pipeline.telemetry.dji_srt import read_dji_srt
from pipeline.telemetry.excerpt import Excerpt, PieceReader, read_excerpts
from pipeline.telemetry.excerpt_formats import dataflash_pieces, tlog_pieces
from pipeline.telemetry.flight_log import FlightLog
from pipeline.telemetry.mapped_file import mapped
from pipeline.telemetry.mavlink_names import FIELDS
from pipeline.telemetry.mavlink_poses import mavlink_flight
from pipeline.telemetry.tables import Progress, RawLog
from pipeline.telemetry.ulog import read_ulog

KNOWN = ".tlog, .mavlink, .bin, .log, .ulg, .srt"
DATAFLASH_HEAD, ULOG_HEAD = b"\xa3\x95", b"ULog"


def read_log(
    path: Path,
    *,
    system: int | None = None,
    dialect: str = "",
    excerpts: tuple[Excerpt, ...] = (),
    progress: Progress = None,
) -> FlightLog:
    """The flight log at `path`.

    With `excerpts` at least they are in it whole, and of the rest a sample, where the format (`.tlog` by the fast
    reader, binary DataFlash) and the log (`read_excerpts`) allow; else everything is.
    `system` picks one vehicle of a MAVLink link by its system id. `dialect` names a pymavlink dialect or a file of
    message definitions (.xml) for MAVLink; "" is ardupilotmega, with the common messages, by the fast reader.
    `progress` is called with the share done, 0 to 1.

    Raises InputFileError where the file is missing, of no known kind, or holds no vehicle, UsageError where there is no
    such dialect.
    """
    kind, head = path.suffix.lower(), bytes(mapped(path, expected="a flight log")[:16])
    reader = _piece_reader(path, kind, head, system, dialect) if excerpts else None
    excerpt = None if reader is None else read_excerpts(reader, excerpts)
    if excerpt is not None:
        return excerpt
    if kind in (".tlog", ".mavlink", ".mav"):
        return mavlink_flight(read_mavlink(path, dialect=dialect, progress=progress), system=system)
    if kind == ".ulg" or head.startswith(ULOG_HEAD):
        return read_ulog(path, progress=progress)
    if kind == ".bin" or head.startswith(DATAFLASH_HEAD):
        return dataflash_flight(read_dataflash(path, progress=progress))
    if kind == ".srt":
        return read_dji_srt(path, progress=progress)
    if kind == ".log":
        return dataflash_flight(read_dataflash_text(path, progress=progress))
    raise InputFileError(
        where=str(path),
        seen=f"a file named {kind or 'without ending'}",
        expected=f"a flight log: {KNOWN}",
        advice="convert it, or give the camera's poses as a .csv",
    )


def _piece_reader(path: Path, kind: str, head: bytes, system: int | None, dialect: str) -> PieceReader | None:
    """How the log is read in pieces; None where its format never is."""
    if kind == ".tlog":
        return tlog_pieces(path, system=system) if COMPILED and not dialect else None
    if kind in (".mavlink", ".mav", ".ulg") or head.startswith(ULOG_HEAD):
        return None
    return dataflash_pieces(path) if kind == ".bin" or head.startswith(DATAFLASH_HEAD) else None


def read_mavlink(path: Path, *, dialect: str = "", progress: Progress = None) -> RawLog:
    """A MAVLink log, by the compiled reader where numba is installed, else, or in another dialect, by pymavlink's."""
    if COMPILED and not dialect:  # imported here: neither is needed, nor quick to import, for other logs
        from pipeline.telemetry.mavlink_fast import read_mavlink_fast

        return read_mavlink_fast(path, fields=FIELDS, progress=progress)
    from pipeline.telemetry.mavlink_plain import read_mavlink_plain

    return read_mavlink_plain(path, dialect=dialect, progress=progress)
