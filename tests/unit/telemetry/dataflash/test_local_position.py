"""Positions of ArduPilot's estimator, where the log has no POS; and accuracies that only the estimator states."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.telemetry import log_sigma, read_log
from pipeline.telemetry.ulog.accuracy import stated_accuracy as ulog_accuracy
from tests.scenes import logs as written_logs
from tests.scenes.logs import Link, dataflash_records, definitions, fly, record

EXTRA = {
    "ORGN": (140, "QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
    "XKF1": (141, "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "XKF4": (142, "QBb", "TimeUS,C,PI"),
}


@pytest.fixture
def estimator(monkeypatch):
    for name, kind in EXTRA.items():
        monkeypatch.setitem(written_logs.KINDS, name, kind)


def xkf1(us, core, north, east, down):
    return record("XKF1", us, core, 0, 0, 0, 1.0, 2.0, 3.0, 0.0, north, east, down, 0, 0, 0, 0)


def without_pos(origin_lat=415000000, primary=1):
    """Two cores; the second, which flies, is 1 km north, 1 km east and 20 m above the origin at 60 degrees north."""
    gone = (132, 130)  # POS, GPS
    found = [*definitions(), *(r for r in dataflash_records(seconds=4)[len(definitions()) :] if r[2] not in gone)]
    found.append(record("ORGN", 100_000_000, 1, 1, 1, 1))  # home, another thing
    found.append(record("ORGN", 100_000_000, 0, origin_lat, 22500000, 10000))
    for i in range(40):
        us = 100_000_000 + 100_000 * i
        found += [xkf1(us, 0, 0.0, 0.0, 0.0), xkf1(us, 1, 1000.0, 1000.0, -20.0)]
        found.append(record("XKF4", us, 0, primary))
    return b"".join(found)


def test_the_core_that_flew_gives_positions_by_ardupilots_own_scale(tmp_path, estimator):
    """1000 m are 1000 / 0.011131884502145034 = 89832.05 of 1e-7 degree north (Location::offset); east over cos."""
    (tmp_path / "a.bin").write_bytes(without_pos(origin_lat=600000000))
    position = read_log(tmp_path / "a.bin").position
    assert position.source == "XKF1"
    lat, lon = np.degrees(position.lat_rad[0]), np.degrees(position.lon_rad[0])
    assert lat == pytest.approx(60.008983205, abs=1e-9)
    assert lon == pytest.approx(2.25 + 0.008983205 / np.cos(np.radians(60.0044916)), abs=1e-9)
    assert "EGM96" in position.height_from
    np.testing.assert_allclose(position.velocity_ned_mps[0], [1.0, 2.0, 3.0])


def test_the_distance_is_that_of_a_second_geodesy_library(tmp_path, estimator):
    """ArduPilot's sphere is the equator's: 0.1 % off the ellipsoid at 60 degrees."""
    geodesic = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    (tmp_path / "a.bin").write_bytes(without_pos(origin_lat=600000000))
    position = read_log(tmp_path / "a.bin").position
    here = np.degrees([position.lon_rad[0], position.lat_rad[0]])
    azimuth, _, metres = geodesic.inv(2.25, 60.0, *here)
    assert metres == pytest.approx(1000 * np.sqrt(2), rel=4e-3)
    assert azimuth == pytest.approx(45.0, abs=0.2)


def test_estimator_status_stands_in_where_the_receiver_states_nothing(tmp_path):
    """MAVLink's ESTIMATOR_STATUS: pos_horiz_accuracy and pos_vert_accuracy are metres, one sigma."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = Link()
    fly(link, seconds=4)
    silent = [p for p in link.packets if p[8 + 7] | p[8 + 8] << 8 != dialect.MAVLINK_MSG_ID_GPS_RAW_INT]
    said = Link()
    for i in range(20):
        said.send(
            dialect.MAVLink_estimator_status_message(100_000_000, 0, *[0.1] * 6, 0.6, 0.8),
            record_s=1748770300.0 + 0.1 * i,
        )
    (tmp_path / "a.tlog").write_bytes(b"".join([*silent, *said.packets]))
    log = read_log(tmp_path / "a.tlog")
    assert (log.accuracy.source, log.accuracy.horizontal_m) == ("ESTIMATOR_STATUS", pytest.approx(0.6))
    assert log_sigma(log).position_bias_m == pytest.approx(np.sqrt((0.36 + 0.64) / 2))


def test_px4_says_what_its_position_is_worth():
    """PX4: eph, epv are metres, one sigma; estimator_status has them where no position topic does."""
    stamp = np.arange(3) * 100_000
    position = {"timestamp": stamp, "eph": np.array([0.0, 0.8, 0.8]), "epv": np.array([1.4, 1.4, 999.0])}
    status = {"timestamp": stamp, "pos_horiz_accuracy": np.full(3, 0.3), "pos_vert_accuracy": np.full(3, 0.4)}
    both = ulog_accuracy({"vehicle_global_position": position, "estimator_status": status})
    assert (both.horizontal_m, both.vertical_m, both.source) == (0.8, 1.4, "vehicle_global_position")
    alone = ulog_accuracy({"estimator_status": status})
    assert (alone.horizontal_m, alone.vertical_m, alone.source) == (0.3, 0.4, "estimator_status")
    assert np.isnan(ulog_accuracy({"vehicle_global_position": {"timestamp": stamp}}).horizontal_m)
