"""What positions are worth over the moments that are asked for: fix by fix, and heights held against the receiver's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry import log_sigma, position_worth, read_log
from pipeline.telemetry.log.flight_log import Accuracy
from pipeline.telemetry.log.receiver import receiver_series
from tests.scenes import logs as written
from tests.scenes.logs import PLACE, RECORD_EPOCH_S, Link, definitions, log_of, record, turned, ulog

LAT, LON = np.degrees(PLACE.lat_rad), np.degrees(PLACE.lon_rad)
HALVES = [(6, 0.02, 0.03)] * 50 + [(3, 2.0, 3.0)] * 50
"""Fix, accuracy across and up: RTK for five seconds, then none."""


def tlog(path):
    """[MAV] GPS_RAW_INT.fix_type 6 is RTK fixed; h_acc, v_acc in mm."""
    link = Link()
    for i, (fix, across, up) in enumerate(HALVES):
        now, ms = RECORD_EPOCH_S + i / 10, 100_000 + 100 * i
        lat, lon = round(LAT * 1e7) + 37, round(LON * 1e7) + 101 * i
        link.send(mav.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0), record_s=now)
        link.send(mav.MAVLink_global_position_int_message(ms, lat, lon, 120000, 0, 0, 0, 0, 0), record_s=now)
        link.send(
            mav.MAVLink_gps_raw_int_message(ms * 1000, fix, lat, lon, 120000, 80, 90, 0, 0, 14, 103100,
                                            round(across * 1000), round(up * 1000), 0, 0, 0),
            record_s=now,
        )  # fmt: skip
    return read_log(link.save(path.with_suffix(".tlog")))


def dataflash(path, monkeypatch):
    """[AP] GPS.Status 6 is RTK fixed; GPA.HAcc, VAcc in centimetres (letter C)."""
    extra = {"GPA": (151, "QBCCC", "TimeUS,I,VDop,HAcc,VAcc")}
    monkeypatch.setattr(written, "KINDS", {**written.KINDS, **extra})
    records = definitions()
    for i, (fix, across, up) in enumerate(HALVES):
        us = 100_000_000 + 100_000 * i
        lat, lon = round(LAT * 1e7) + 37, round(LON * 1e7) + 101 * i
        records += [
            record("GPS", us, 0, fix, 100 * i, 2300, 14, 80, lat, lon, 12000, 10, 90, 0, 0, 1),
            record("GPA", us, 0, 100, round(across * 100), round(up * 100)),
            record("POS", us, lat, lon, 120.0, 0.0, 0.0),
        ]
    path.with_suffix(".bin").write_bytes(b"".join(records))
    return read_log(path.with_suffix(".bin"))


def px4(path):
    """[PX4] sensor_gps.fix_type 6 is RTK fixed; eph, epv in m."""
    at = [100 + i / 10 for i in range(100)]
    fields = {"lat": "i4", "lon": "i4", "alt": "i4", "alt_ellipsoid": "i4", "eph": "f4", "epv": "f4", "fix_type": "u1"}
    rows = [
        {"t": t, "lat": LAT * 1e7 + 37, "lon": LON * 1e7 + 101 * i, "alt": 120000, "alt_ellipsoid": 103100,
         "eph": across, "epv": up, "fix_type": fix}
        for i, (t, (fix, across, up)) in enumerate(zip(at, HALVES, strict=True))
    ]  # fmt: skip
    rows = [{name: value if name in ("t", "eph", "epv") else int(value) for name, value in row.items()} for row in rows]
    return read_log(
        ulog(
            path.with_suffix(".ulg"),
            {"vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": turned(90)} for t in at]),
             "vehicle_gps_position": (fields, rows)},
        )
    )  # fmt: skip


@pytest.mark.parametrize("form", ["tlog", "dataflash", "ulog"])
def test_a_fix_that_is_lost_on_the_way(tmp_path, monkeypatch, form):
    path = tmp_path / "a"
    log = {"tlog": lambda: tlog(path), "dataflash": lambda: dataflash(path, monkeypatch), "ulog": lambda: px4(path)}[
        form
    ]()
    begin = float(log.position.time_s[0])
    early, late, whole = (log_sigma(log, (begin + a, begin + b)) for a, b in ((0.5, 4), (6, 9), (0, 9.9)))
    assert early.position_bias_m == pytest.approx(np.sqrt((0.02**2 + 0.03**2) / 2), rel=0.01)
    assert late.position_bias_m == pytest.approx(np.sqrt((2**2 + 3**2) / 2), rel=0.01)
    assert whole.position_bias_m == pytest.approx(np.sqrt((2**2 + 3**2) / 4), rel=0.02)
    assert early.position_m == pytest.approx(0.02)
    assert not position_worth(log, (begin + 0.5, begin + 4)).notes
    assert "RTK fixed 50 %, 3D 50 %" in position_worth(log, (begin, begin + 9.9)).notes[0]


def receiver(fix, **more):
    n = len(fix)
    given = {"horizontal_m": np.full(n, np.nan), "vertical_m": np.full(n, np.nan), "height_m": np.full(n, 100.0)} | more
    return receiver_series(source="GPS_RAW_INT", time_s=np.linspace(0, 2, n), fix=np.array(fix, float), **given)


@pytest.mark.parametrize(("fix", "sigma"), [(6, 0.03), (5, 0.4), (4, 1.5), (3, 3.0)])
def test_a_fix_whose_accuracy_nobody_states(fix, sigma):
    log = replace(log_of(), receiver=receiver([fix] * 20))
    assert log_sigma(log, (0.0, 2.0)).position_bias_m == pytest.approx(sigma)


@pytest.mark.parametrize(("off_m", "said"), [(0.5, False), (8.0, True)])
def test_a_barometers_heights_are_held_against_the_receivers(off_m, said):
    stated = Accuracy(horizontal_m=1.0, vertical_m=1.5, source="GPS_RAW_INT")
    log = replace(
        log_of(), accuracy=stated,
        receiver=receiver([3] * 20, horizontal_m=np.full(20, 1.0), vertical_m=np.full(20, 1.5),
                          height_m=np.full(20, 100.0 - off_m)),
    )  # fmt: skip
    worth = position_worth(log)
    assert worth.vertical_m == pytest.approx(np.hypot(1.5, off_m) if said else 1.5)
    assert bool(worth.notes) == said
    assert log_sigma(log).position_bias_m == pytest.approx(np.sqrt((1 + worth.vertical_m**2) / 2))


def test_heights_that_count_from_elsewhere_for_a_while_are_told():
    """ArduPilot's GLOBAL_POSITION_INT before it knows its home: hundreds of metres low in a public log."""
    height = np.where(np.arange(20) < 5, 689.0, 100.0)
    log = replace(log_of(), receiver=receiver([3] * 20, height_m=height))
    assert "589 m off" in position_worth(log).notes[0]
    assert "0.0 and 0.4 s" in position_worth(log).notes[0]
    assert log_sigma(log).position_bias_m == 3.0
    assert log_sigma(log, (0.0, 0.3)).position_bias_m == 3.0, "too few"
    assert log_sigma(log, (0.0, 2.0)).position_bias_m > 100


def test_the_receivers_own_heights_are_not_held_against_themselves():
    log = log_of()
    assert log.position is not None
    log = replace(log, position=replace(log.position, source="GPS_RAW_INT"), receiver=receiver([3] * 20))
    assert position_worth(log).notes == ()
