"""The formats that are read in pieces: `.tlog`, which has the recorder's clock beside the vehicle's, and DataFlash."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.telemetry.dataflash.attitude import primary_core
from pipeline.telemetry.dataflash.boots import continued
from pipeline.telemetry.dataflash.flight import dataflash_flight
from pipeline.telemetry.dataflash.local_position import LOCAL_MESSAGES, lane_changes
from pipeline.telemetry.dataflash.messages.read import read_dataflash
from pipeline.telemetry.dataflash.tables import time_of
from pipeline.telemetry.excerpts.excerpt import PieceReader, Readings
from pipeline.telemetry.log.flight_log import FlightLog
from pipeline.telemetry.log.series import close_call
from pipeline.telemetry.log.tables import RawLog
from pipeline.telemetry.mavlink.flight import mavlink_flight
from pipeline.telemetry.mavlink.gimbal import gimbal_of
from pipeline.telemetry.mavlink.packets.names import FIELDS
from pipeline.telemetry.mavlink.vehicle import BOOT_MESSAGES, boot_readings, votes_of

CLEAR = 2.0
"""A vehicle with this many times the positions of any other one in a sample has more of them in the whole log too."""


def tlog_pieces(path: Path, *, system: int | None, gimbal: int | None = None) -> PieceReader:
    """A `.tlog` by the compiled reader; `system` as for `read_log`."""
    from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast  # here, for it is slow to import

    return PieceReader(
        size=path.stat().st_size,
        read=lambda pieces: read_mavlink_fast(path, fields=FIELDS, pieces=pieces),
        glance=lambda pieces: read_mavlink_fast(path, wanted=BOOT_MESSAGES, fields=FIELDS, pieces=pieces),
        flight=lambda raw: mavlink_flight(raw, system=system, gimbal=gimbal),
        readings=_tlog_readings,
        doubtful=lambda raw, log: _tlog_doubtful(raw, log, system),
    )


def dataflash_pieces(path: Path, *, gimbal: int | None = None) -> PieceReader:
    """A binary DataFlash log.

    Its second clock is GPS time: without a fix a time that began anew between two pieces and came past the earlier's
    before the next is not told (ArduPilot begins a file with every boot); nor is a parameter that was set between them.
    """
    return PieceReader(
        size=path.stat().st_size,
        read=lambda pieces: read_dataflash(path, pieces=pieces),
        glance=lambda pieces: read_dataflash(path, pieces=pieces, complete=False),
        flight=lambda raw: dataflash_flight(raw, gimbal=gimbal),
        readings=_dataflash_readings,
        doubtful=_dataflash_doubtful,
    )


def _tlog_readings(raw: RawLog, log: FlightLog) -> Readings:
    assert log.system is not None
    assert log.component is not None
    place, boot_s, record_s = boot_readings(raw, (log.system, log.component))
    return Readings(place=place, time_s=boot_s, record_s=record_s)


def _tlog_doubtful(raw: RawLog, log: FlightLog, system: int | None) -> bool:
    """Whether vehicle, gimbal or attitudes are a close choice, or no recorder's clock stands beside the vehicle's."""
    votes = sorted((n for who, n in votes_of(raw).items() if system in (None, who[0])), reverse=True)
    contested = len(votes) > 1 and votes[0][0] <= CLEAR * votes[1][0]
    device = raw.table("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda t: np.asarray(t.system == log.system))
    gimbals = 0 if device is None else len(np.unique(gimbal_of(device)))
    own = (
        raw.table(name, lambda t: (t.system == log.system) & (t.component == log.component))
        for name in ("ATTITUDE_QUATERNION", "ATTITUDE")
    )
    return raw.format != "tlog" or log.record_clock is None or contested or gimbals > 1 or close_call(*own)


def _dataflash_readings(raw: RawLog, log: FlightLog) -> Readings:
    tables = list(raw.tables.values())
    place = np.concatenate([table.place for table in tables]) if tables else np.empty(0, np.int64)
    time = np.concatenate([time_of(table) for table in tables]) if tables else np.empty(0)
    told = np.isfinite(time)
    order = np.argsort(place[told], kind="stable")
    time = time[told][order]
    return Readings(place=place[told][order], time_s=time, record_s=np.full(len(time), np.nan))


def _dataflash_doubtful(raw: RawLog, log: FlightLog) -> bool:
    """Whether attitudes are a close choice, the estimator's positions lack an origin, or there are several boots."""
    source = "" if log.position is None else log.position.source
    local = {name for names, _ in LOCAL_MESSAGES for name in names}
    rootless = source not in ("POS", *local) and not local.isdisjoint(raw.tables)
    turning = source in local and lane_changes(raw) > 0
    joined = len(continued(raw).notes) > len(raw.notes)
    return joined or rootless or turning or close_call(primary_core(raw), raw.table("ATT"))
