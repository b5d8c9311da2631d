"""Logs of a simulated vehicle with the simulator's truth in them, as ArduPilot writes it: error over claimed sigma."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry import inspect_log, read_log
from pipeline.telemetry.camera_pose.truth import pose_error
from tests.scenes import logs as written
from tests.scenes.logs import PLACE, RECORD_EPOCH_S, Link, definitions, log_of, record, turned, ulog

LAT, LON = np.degrees(PLACE.lat_rad), np.degrees(PLACE.lon_rad)
METRE = 1 / 111_320.0
OFF_DEG, OFF_M = 0.3, 0.6


def dataflash(path, monkeypatch):
    """[AP] SIM: TimeUS, Roll, Pitch (hundredths of a degree), Yaw, Alt above sea, Lat, Lng, quaternion."""
    extra = {"SIM": (160, "QccCfLLffff", "TimeUS,Roll,Pitch,Yaw,Alt,Lat,Lng,Q1,Q2,Q3,Q4")}
    monkeypatch.setattr(written, "KINDS", {**written.KINDS, **extra})
    records = definitions()
    for i in range(100):
        us = 100_000_000 + 100_000 * i
        lat, lon = round(LAT * 1e7), round(LON * 1e7) + 101 * i
        records.append(record("SIM", us, 200, -100, 9000, 120.0, lat, lon, 1, 0, 0, 0))
        off = round(OFF_M * METRE * 1e7)
        records.append(record("POS", us + 30_000, lat + off, lon + 30, 120.0 + OFF_M, 0.0, 0.0))
        records.append(record("ATT", us + 50_000, 0, 230, 0, -130, 0, 9000 + 30, 0, 0))
    path.write_bytes(b"".join(records))
    return read_log(path)


def tlog(path):
    """[MAV] SIMSTATE: radians and 1e-7 degrees, no height, no time of its own."""
    link = Link()
    for i in range(100):
        now, ms = RECORD_EPOCH_S + i / 10, 100_000 + 100 * i
        lat, lon = round(LAT * 1e7), round(LON * 1e7) + 101 * i
        true = np.radians([2.0, -1.0, 90.0])
        roll, pitch, yaw = true + np.radians(OFF_DEG)
        off = round(OFF_M * METRE * 1e7)
        link.send(mav.MAVLink_simstate_message(*true, 0, 0, 0, 0, 0, 0, lat, lon), record_s=now)
        link.send(mav.MAVLink_attitude_message(ms, roll, pitch, yaw, 0, 0, 0), record_s=now)
        link.send(mav.MAVLink_global_position_int_message(ms, lat + off, lon, 120000, 0, 0, 0, 0, 0), record_s=now)
    return read_log(link.save(path))


def test_dataflash(tmp_path, monkeypatch):
    log = dataflash(tmp_path / "a.bin", monkeypatch)
    found = pose_error(log)
    assert found.position_m == pytest.approx(OFF_M * np.sqrt(2 / 3), rel=0.02)
    assert np.degrees(found.attitude_rad) == pytest.approx(OFF_DEG, rel=0.03)
    assert found.in_sigmas[0] == pytest.approx(found.position_m / np.hypot(3, 1))
    assert found.in_sigmas[1] == pytest.approx(OFF_DEG / np.hypot(0.5, 0.5), rel=0.03)
    assert any("simulator's truth (SIM): positions off by 0.49 m" in line for line in inspect_log(log).words)


def test_tlog(tmp_path):
    """Only what lies in the plane: there is no height in the truth."""
    found = pose_error(tlog(tmp_path / "a.tlog"))
    assert found.position_m == pytest.approx(OFF_M * np.sqrt(1 / 2), rel=0.02)
    assert np.degrees(found.attitude_rad) == pytest.approx(OFF_DEG, rel=0.03)


def test_px4(tmp_path):
    """[PX4] vehicle_global_position_groundtruth, vehicle_attitude_groundtruth of its simulators."""
    place = {"lat": "f8", "lon": "f8", "alt": "f4"}
    at = [100 + i / 10 for i in range(100)]
    true = [{"t": t, "lat": LAT, "lon": LON + 1e-5 * i, "alt": 120.0} for i, t in enumerate(at)]
    told = [{**row, "lat": LAT + OFF_M * METRE, "alt": 120.0 + OFF_M} for row in true]
    looks = ({"q[4]": "q"}, [{"t": t, "q[4]": turned(90, -1, 2)} for t in at])
    off = ({"q[4]": "q"}, [{"t": t, "q[4]": turned(90, -1, 2 + OFF_DEG)} for t in at])
    topics = {"vehicle_global_position": (place, told), "vehicle_global_position_groundtruth": (place, true),
              "vehicle_attitude": off, "vehicle_attitude_groundtruth": looks}  # fmt: skip
    found = pose_error(read_log(ulog(tmp_path / "a.ulg", topics)))
    assert found.position_m == pytest.approx(OFF_M * np.sqrt(2 / 3), rel=0.02)
    assert np.degrees(found.attitude_rad) == pytest.approx(OFF_DEG / np.sqrt(3), rel=0.03)


def test_a_real_flight_has_no_truth():
    assert pose_error(log_of()) is None
