"""Whose receiver, whose gimbal, and steps that an estimator tells of itself; each log packed by hand.

Sources: [MAV] MAVLink message definitions, [AP] ArduPilot's log documentation, [PX4] its message files.
"""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.geometry import rotation
from pipeline.telemetry import read_log
from tests.scenes import logs as written
from tests.scenes.logs import RECORD_EPOCH_S, Link, definitions, record, turned, ulog

LAT, LON = 282_000_000, 1_129_000_000
EXTRA = {
    "MNT": (150, "QBffff", "TimeUS,I,Roll,Pitch,YawB,YawE"),
    "XKF1": (153, "QBffffff", "TimeUS,C,Roll,Pitch,Yaw,PN,PE,PD"),
    "XKF4": (154, "QBB", "TimeUS,C,PI"),
    "ORGN": (155, "QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
    "AHR2": (156, "QffffLL", "TimeUS,Roll,Pitch,Yaw,Alt,Lat,Lng"),
}


@pytest.fixture(autouse=True)
def _kinds(monkeypatch):
    monkeypatch.setattr(written, "KINDS", {**written.KINDS, **EXTRA})


def linked(path, *extra, alt=lambda i: 120_000):
    """Ten seconds of attitudes and positions at 10 Hz; each of `extra` gives (message, component, system) of row i."""
    link = Link()
    for i in range(100):
        ms, now = 100_000 + 100 * i, RECORD_EPOCH_S + i / 10
        link.send(mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), record_s=now)
        link.send(mav.MAVLink_attitude_message(ms, 0.01, -0.02, 1.5, 0, 0, 0), record_s=now)
        link.send(
            mav.MAVLink_global_position_int_message(ms, LAT, LON + 100 * i, alt(i), 50000, 0, 1000, 0, 65535),
            record_s=now,
        )
        for one in extra:
            message, component, system = one(i, ms)
            link.send(message, record_s=now, component=component, system=system)
    return read_log(link.save(path))


def test_the_second_receiver_where_the_first_has_no_fix(tmp_path):
    """[MAV] GPS_RAW_INT of a receiver that sees nothing, GPS2_RAW with RTK."""
    log = linked(
        tmp_path / "a.tlog",
        lambda i, ms: (mav.MAVLink_gps_raw_int_message(ms * 1000, 0, 0, 0, 0, *[65535] * 4, 255), 1, 1),
        lambda i, ms: (
            mav.MAVLink_gps2_raw_message(
                ms * 1000, 6, LAT, LON, 120_000, *[65535] * 4, 12, 0, 0, 0, 103_000, 20, 30, 0, 0
            ),
            1,
            1,
        ),
    )
    assert log.receiver.source == log.accuracy.source == "GPS2_RAW"
    assert set(log.receiver.fix.tolist()) == {6}


@pytest.mark.parametrize("nothing", [2**31 - 1, -(2**31)])
def test_a_height_that_cannot_be_is_none(tmp_path, nothing):
    log = linked(tmp_path / "a.tlog", alt=lambda i: nothing if i in (40, 41) else 120_000)
    assert np.flatnonzero(~log.position.valid).tolist() == [40, 41]


def gimbal(i, ms):
    q = [float(value) for value in turned(0, -30, 0)]
    return mav.MAVLink_gimbal_device_attitude_status_message(0, 0, ms, 32 | 12, q, 0, 0, 0, 0), 154, 9


def test_a_gimbal_of_another_system_is_named(tmp_path):
    """[MAV] a gimbal whose system id was never set; of another vehicle, with an autopilot, nothing has to be said."""
    log = linked(tmp_path / "a.tlog", gimbal)
    assert log.gimbal is None
    assert any("sent by system 9, not by the vehicle's 1" in note for note in log.notes)
    other = lambda i, ms: (mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), 1, 9)  # noqa: E731
    assert not any("system 9, not" in note for note in linked(tmp_path / "b.tlog", gimbal, other).notes)


def flashed(path, *kinds):
    rows = [row for i in range(100) for kind in kinds for row in [kind(100_000_000 + 100_000 * i, i)] if row]
    path.write_bytes(b"".join([*definitions(), *rows]))
    return read_log(path)


def att(us, i):
    return record("ATT", us, 0, 57, 0, -115, 0, (9000 + 200 * i) % 36000, 0, 0)


def pos(us, i):
    return record("POS", us, LAT, LON + 100 * i, 100.0, 50.0, 50.0)


def gps(instance, used, shift=0):
    def row(us, i):
        where = LAT, LON + 100 * i + shift, 10000
        return record("GPS", us, instance, 3, 100_000 + 100 * i, 2300, 14, 80, *where, 10, 90, 0, 0, used(i))

    return row


def test_receivers_that_take_over_from_each_other(tmp_path):
    """[AP] GPS.U of two receivers 3 m apart."""
    one, other = gps(0, lambda i: i < 50), gps(1, lambda i: i >= 50, 300)
    said = "receivers 0 and 1 are in use by turns, 1 changes"
    assert any(said in note for note in flashed(tmp_path / "a.bin", att, one, other).notes)
    assert not any("by turns" in note for note in flashed(tmp_path / "b.bin", att, pos, one, other).notes)


def test_cores_that_take_over_from_each_other(tmp_path):
    """[AP] XKF1.C of two cores 100 m apart, XKF4.PI of the one that flies: no other message has positions."""

    def core(us, i):
        return b"".join(record("XKF1", us, c, 0.0, 0.0, 90.0, 0.5 * i + 100.0 * c, 0.0, -50.0) for c in (0, 1))

    log = flashed(
        tmp_path / "a.bin",
        att,
        lambda us, i: record("ORGN", us, 0, LAT, LON, 10000) if i == 0 else b"",
        lambda us, i: b"".join(record("XKF4", us, c, i >= 50) for c in (0, 1)),
        core,
    )
    assert log.position.source == "XKF1"
    north = np.degrees(log.position.lat_rad - np.radians(28.2)) * 110_830.0
    np.testing.assert_allclose(north, [0.5 * i + 100.0 * (i >= 50) for i in range(100)], atol=1.0)
    assert any("changed 1 times (PI)" in note for note in log.notes)


@pytest.mark.parametrize("boot", [True, False])
@pytest.mark.parametrize("attitude", [True, False])
def test_the_second_estimator_of_a_link(tmp_path, boot, attitude):
    """[MAV] AHRS2, radians: attitudes where there are no others; without a boot time the recorder's is log time."""
    link = Link()
    for i in range(100):
        now, ms = RECORD_EPOCH_S + i / 10, 100_000 + 100 * i
        link.send(mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), record_s=now)
        if boot:
            link.send(mav.MAVLink_system_time_message(0, ms), record_s=now)
        if attitude and boot:
            link.send(mav.MAVLink_attitude_message(ms, 0.3, 0.2, 0.1, 0, 0, 0), record_s=now)
        ahrs2 = mav.MAVLink_ahrs2_message(0.01, -0.02, 1.5, 100.0, LAT, LON + 100 * i)
        link.send(ahrs2, record_s=now)
    log = read_log(link.save(tmp_path / "a.tlog"))
    assert log.position.source == "AHRS2"
    assert log.position.valid.all()
    np.testing.assert_allclose(np.diff(log.position.time_s), 0.1, atol=1e-5)
    assert log.position.time_s[0] == pytest.approx(100.0 if boot else RECORD_EPOCH_S, abs=0.01)
    assert log.attitude.source == ("ATTITUDE" if attitude and boot else "AHRS2")
    assert any("no message carries the vehicle's boot time" in note for note in log.notes) == (not boot)
    q = rotation.ned_from_frd(*((0.1, 0.2, 0.3) if attitude and boot else (1.5, -0.02, 0.01)))
    np.testing.assert_allclose(np.abs(log.attitude.ned_from_body[0] @ q), 1.0, atol=1e-7)


def test_the_second_estimator_alone(tmp_path):
    """[AP] AHR2, degrees."""
    log = flashed(tmp_path / "a.bin", lambda us, i: record("AHR2", us, 0.5, -1.0, 90.0, 100.0, LAT, LON + 100 * i))
    assert log.position.source == log.attitude.source == "AHR2"
    np.testing.assert_allclose(np.abs(log.attitude.ned_from_body[0] @ turned(90.0, -1.0, 0.5)), 1.0, atol=1e-9)


@pytest.mark.parametrize(("off_deg", "said"), [(0.0, False), (25.0, True)])
def test_two_yaws_of_one_mount(tmp_path, off_deg, said):
    """[AP] MNT.YawE counts from north, YawB from the vehicle."""
    log = flashed(
        tmp_path / "a.bin",
        att,
        pos,
        lambda us, i: record("MNT", us, 0, 0.0, -30.0, -40.0, (50.0 + 2 * i + off_deg + 180.0) % 360.0 - 180.0),
    )
    assert any("YawE is used" in note for note in log.notes) == said


def test_yaw_from_north_that_was_never_written(tmp_path):
    log = flashed(tmp_path / "a.bin", att, pos, lambda us, i: record("MNT", us, 0, 0.0, -30.0, -40.0, 0.0))
    assert set(log.gimbal.frame.tolist()) == {1}
    np.testing.assert_allclose(np.abs(log.gimbal.attitude[0] @ turned(-40.0, -30.0, 0.0)), 1.0, atol=1e-6)


TIMES = [100 + 0.1 * i for i in range(100)]


def px4(path, *, place=lambda i: (0.0, 0), yaw=lambda i: (90.0, 0), more=()):
    topics = {
        "vehicle_attitude": (
            {"q[4]": "q", "quat_reset_counter": "u1"},
            [{"t": t, "q[4]": turned(yaw(i)[0]), "quat_reset_counter": yaw(i)[1]} for i, t in enumerate(TIMES)],
        ),
        "vehicle_global_position": (
            {"lat": "f8", "lon": "f8", "alt": "f4", "lat_lon_reset_counter": "u1"},
            [{"t": t, "lat": 28.2 + place(i)[0], "lon": 112.9 + 1e-5 * i, "alt": 100.0,
              "lat_lon_reset_counter": place(i)[1]} for i, t in enumerate(TIMES)],
        ),
        **dict(more),
    }  # fmt: skip
    return read_log(ulog(path, topics))


def test_states_that_were_set_anew(tmp_path):
    """[PX4] lat_lon_reset_counter, quat_reset_counter: what steps by more than it is worth is told."""
    log = px4(tmp_path / "a.ulg", place=lambda i: (1e-4 * (i > 50), i > 50), yaw=lambda i: (90 + 40 * (i > 30), i > 30))
    assert any("position anew, by 11.1 m at log time 105.1 s" in note for note in log.notes)
    assert any("attitude anew, by 40.0 degrees at log time 103.1 s" in note for note in log.notes)
    calm = px4(tmp_path / "b.ulg", place=lambda i: (1e-7 * (i > 50), i > 50), yaw=lambda i: (90 + 5 * i, i > 30))
    assert not any("anew" in note for note in calm.notes)


def test_two_receivers_of_px4(tmp_path):
    def receiver(fix):
        fields = {"latitude_deg": "f8", "longitude_deg": "f8", "altitude_msl_m": "f8", "fix_type": "u1"}
        row = {"latitude_deg": 28.2, "longitude_deg": 112.9, "altitude_msl_m": 100.0, "fix_type": fix}
        return fields, [{"t": t, **row} for t in TIMES]

    both = px4(tmp_path / "a.ulg", more={"sensor_gps.0": receiver(3), "sensor_gps.1": receiver(6)}.items())
    assert any("receivers 0, 1 have a fix in sensor_gps" in note for note in both.notes)
    one = px4(tmp_path / "b.ulg", more={"sensor_gps.0": receiver(0), "sensor_gps.1": receiver(6)}.items())
    assert not any("have a fix" in note for note in one.notes)
