"""What can be wrong with a log, kind by kind, in every format that has it; each cell is a log packed by hand.

kind          .tlog                      DataFlash                  ULog                        subtitles
whose row     heartbeat, system, gimbal  instance (I), receiver U   instance, gimbal_device_id  one flight
two boots     falls, leaps (recorder,    falls, leaps (GPS time),   falls, joined logs          cues that fall back
              UTC)                       definitions repeated
validity      fix_type, encoder error    Status                     lat_lon_valid, alt_valid    0, 0
frames        servo flags, yaw, north    MNT of servos              flags of servos             a heading that is still
heights       equal, EGM96, parameter    equal (AEl), parameter     equal                       home, wrong pressure
sigmas        receiver in use            GPA of the one in use      eph                         digits, staircase
clocks        set later, week            loses time                 POSIX, boot_time_utc_us     the video's own
definitions   checksums fix them         length, redefined          read by pyulog              dialects

Metadata of ST 0601 (klv/test_klv.py) and flight records (flight_records/) have the same cells where they have the kind:
kind          ST 0601                                     flight records
whose row     streams by PID, changes of platform, sensor one vehicle in a file
two boots     stamps that fall back or leap               times that fall back, dates that leap
validity      error and out-of-range values, checksum     isGPSUsed, 0, 0
frames        against the platform's body, by standard    a heading that is still
heights       104, 75 or 15: the item says the datum      unit in the header, home
sigmas        none is carried                             DJI's instruments; digits as of subtitles
clocks        leap seconds, stamps that were set          ticks of whole seconds, local dates
definitions   lengths (BER), versions                     header, delimiter, unit
Two boots: test_second_boots.py.
Sources: [MAV] MAVLink message definitions, [AP] ArduPilot's log and parameter documentation, [PX4] its message files.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.geometry import rotation
from pipeline.telemetry import Mount, camera_poses, log_seconds, log_sigma, read_log, resolve_start, utc_at
from pipeline.telemetry.log.flight_log import BODY, EARTH, HEADING
from tests.scenes import logs as written
from tests.scenes.logs import (
    BOOT_UTC_S,
    PLACE,
    RECORD_EPOCH_S,
    Link,
    dataflash_records,
    definitions,
    fly,
    record,
    turned,
    ulog,
)

LAT, LON = np.degrees(PLACE.lat_rad), np.degrees(PLACE.lon_rad)
EXTRA = {
    "MNT": (150, "QBffffff", "TimeUS,I,Roll,Pitch,YawB,YawE,DesRoll,DesPitch"),
    "GPA": (151, "QBHfff", "TimeUS,I,VDop,HAcc,VAcc,AEl"),
    "PARM": (152, "QNf", "TimeUS,Name,Value"),
}


@pytest.fixture(autouse=True)
def _kinds(monkeypatch):
    monkeypatch.setattr(written, "KINDS", {**written.KINDS, **EXTRA})


def tlog(path, link):
    link.packets.sort(key=lambda packet: packet[:8])
    path.write_bytes(b"".join(link.packets))
    return read_log(path)


def dataflash(path, *records):
    path.write_bytes(b"".join([*definitions(), *records]))
    return read_log(path)


def swaying(t):
    """Yaw, pitch, roll in degrees of a body that sways by ten degrees."""
    return 90.0 + 20 * np.sin(0.5 * t), 10 * np.sin(2 * t), 10 * np.cos(1.7 * t)


def servo(t):
    """What a servo gimbal's angles against the body are where it holds the camera level, pitched down by 30 degrees."""
    yaw, pitch, roll = swaying(t)
    return rotation.multiply(rotation.conjugate(turned(yaw, pitch, roll)), turned(yaw, -30, 0))


def facing(log, at):
    track = camera_poses(
        log, camera="c", frame=np.arange(len(at)), log_time_s=np.array(at), mount=Mount(gimbal=True),
        lever_arm_m=np.zeros(3), origin=PLACE, where="w",
    )  # fmt: skip
    return np.degrees(rotation.camera_yaw_pitch_roll(track.enu_from_cam))


def swaying_link(say, *, seconds=20.0, autopilot=3):
    """A swaying vehicle on a link, with what `say(i, t, ms)` sends beside it at 10 Hz."""
    link = Link()
    for i in range(round(seconds * 10)):
        t, ms, now = i / 10, 100_000 + 100 * i, RECORD_EPOCH_S + i / 10 + 0.03
        yaw, pitch, roll = np.radians(swaying(t))
        link.send(mav.MAVLink_attitude_message(ms, roll, pitch, yaw, 0, 0, 0), record_s=now)
        link.send(
            mav.MAVLink_global_position_int_message(ms, round(LAT * 1e7), round(LON * 1e7), 120000, 0, 0, 0, 0, 0),
            record_s=now,
        )
        if i % 10 == 0:
            link.send(mav.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3), record_s=now)
        for message, component in say(i, t, ms):
            link.send(message, record_s=now, component=component)
    return link


def device(ms, q, flags, *, failure=0, delta_yaw=float("nan"), number=0):
    return mav.MAVLink_gimbal_device_attitude_status_message(
        0, 0, ms, flags, np.asarray(q).tolist(), 0, 0, 0, failure, delta_yaw, 0, number
    )


class TestWhoseRow:
    def test_an_autopilot_is_what_its_heartbeat_says(self, tmp_path):
        """[MAV] HEARTBEAT.autopilot = MAV_AUTOPILOT_INVALID: a companion computer that relays more positions."""
        link = Link()
        fly(link, seconds=5)
        for i in range(200):
            now = RECORD_EPOCH_S + i / 40 + 0.03
            message = mav.MAVLink_global_position_int_message(100_000 + 25 * i, 10**8, 10**8, 0, 0, 0, 0, 0, 0)
            link.send(message, record_s=now, component=191)
            link.send(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), record_s=now, component=191)
        log = tlog(tmp_path / "a.tlog", link)
        assert (log.system, log.component, log.systems) == (1, 1, (1,))
        assert np.degrees(log.position.lat_rad[0]) == pytest.approx(LAT)

    def test_one_camera_of_several_is_taken(self, tmp_path):
        """[MAV] CAMERA_FEEDBACK.cam_idx."""
        link = Link()
        fly(link, seconds=5)
        for i in range(6):
            for camera in range(1 + (i < 3)):
                message = mav.MAVLink_camera_feedback_message(
                    round((BOOT_UTC_S + 101 + i / 2 + 0.1 * camera) * 1e6), 0, camera, i, 0, 0, 0, 0, 0, 0, 0, 0, 0
                )
                link.send(message, record_s=RECORD_EPOCH_S + 1.03 + i / 2 + 0.1 * camera)
        log = tlog(tmp_path / "a.tlog", link)
        np.testing.assert_allclose(log.camera_event_s, 101 + np.arange(6) / 2, atol=1e-3)
        assert log.camera_event_source == "CAMERA_FEEDBACK"
        assert any("2 cameras speak" in note for note in log.notes)

    def test_camera_trigger_is_an_exposure_too(self, tmp_path):
        """[MAV] CAMERA_TRIGGER: time_usec, seq."""
        link = Link()
        fly(link, seconds=5)
        for i in range(4):
            link.send(
                mav.MAVLink_camera_trigger_message(round((101.5 + i) * 1e6), i), record_s=RECORD_EPOCH_S + 1.53 + i
            )
        log = tlog(tmp_path / "a.tlog", link)
        np.testing.assert_allclose(log.camera_event_s, 101.5 + np.arange(4), atol=1e-6)
        assert log.camera_event_source == "CAMERA_TRIGGER"

    def test_accuracy_is_that_of_the_receiver_in_use(self, tmp_path):
        """[AP] GPS.U and GPA.I: the second receiver flies."""
        records = []
        for i in range(50):
            us = 100_000_000 + 200_000 * i
            for instance, accuracy in ((0, 9.0), (1, 0.5)):
                fix = (4, 1000 * i, 2300, 14, 80, LAT * 1e7, LON * 1e7 + i, 10000, 10, 90, 0, 0)
                records.append(record("GPS", us, instance, *fix, instance))
                records.append(record("GPA", us, instance, 100, accuracy, accuracy, 0))
        assert dataflash(tmp_path / "a.bin", *records).accuracy.horizontal_m == 0.5

    @pytest.mark.parametrize("asked", [0, 1])
    def test_mnt_instances(self, tmp_path, asked):
        records = dataflash_records()[len(definitions()) :]
        for i in range(100):
            for instance, pitch in ((0, -30.0), (1, -70.0)):
                records.append(record("MNT", 100_000_000 + 100_000 * i, instance, 0, pitch, 0, 0, 0, 0))
        path = tmp_path / "a.bin"
        log = dataflash(path, *records)
        assert log.gimbals == (0, 1)
        assert any("write gimbal = 0 or 1" in note for note in log.notes)
        log = read_log(path, gimbal=asked)
        assert facing(log, [105.0])[0, 1] == pytest.approx((-30, -70)[asked], abs=1e-4)
        assert log.gimbals == ()

    def test_px4_instance_whose_number_is_another_s_device(self, tmp_path):
        """[PX4] instance 0 is device 1, instance 1 says no device: two gimbals."""
        topics = flying()
        for name, pitch, number in (("", -30, 1), (".1", -70, 0)):
            topics["gimbal_device_attitude_status" + name] = gimbal_topic(
                [(t, turned(90, pitch), 64 | 12, number) for t in np.arange(100, 105, 0.1)]
            )
        assert len(read_log(ulog(tmp_path / "a.ulg", topics)).gimbals) == 2

    @pytest.mark.parametrize("asked", [1, 2])
    def test_px4_gimbals(self, tmp_path, asked):
        """[PX4] gimbal_device_attitude_status.gimbal_device_id."""
        topics = flying()
        topics["gimbal_device_attitude_status"] = gimbal_topic(
            [
                (t, turned(90, pitch, 0), 64 | 12, n)
                for t in np.arange(100, 105, 0.1)
                for n, pitch in ((1, -30), (2, -70))
            ]
        )
        log = read_log(ulog(tmp_path / "a.ulg", topics), gimbal=asked)
        assert facing(log, [102.0])[0, 1] == pytest.approx((-30, -70)[asked - 1], abs=1e-3)
        assert read_log(tmp_path / "a.ulg").gimbals == (1, 2)


def gimbal_topic(rows):
    """gimbal_device_attitude_status of (time, quaternion, flags, device)."""
    return (
        {"device_flags": "u2", "gimbal_device_id": "u1", "q[4]": "q"},
        [{"t": t, "device_flags": flags, "gimbal_device_id": n, "q[4]": q} for t, q, flags, n in rows],
    )


def flying(begin=100.0, seconds=5.0, **more):
    """vehicle_attitude and vehicle_global_position of a vehicle that flies east, heading east."""
    q = turned(90)
    times = np.arange(begin, begin + seconds, 0.1)
    position = {"lat": "f8", "lon": "f8", "alt": "f4", "alt_ellipsoid": "f4", "lat_lon_valid": "b", "alt_valid": "b"}
    rows = [
        {"t": t, "lat": LAT, "lon": LON + 1e-5 * i, "alt": 100.0, "alt_ellipsoid": 83.1, "lat_lon_valid": True,
         "alt_valid": True, **{name: value(i) for name, value in more.items()}}
        for i, t in enumerate(times)
    ]  # fmt: skip
    return {
        "vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": q} for t in times]),
        "vehicle_global_position": (position, rows),
    }


class TestTwoBoots:
    @pytest.mark.parametrize("gps", [True, False])
    def test_dataflash(self, tmp_path, gps):
        """Log time goes on by GPS time, else an hour later."""
        first, second = dataflash_records(seconds=5), dataflash_records(seconds=5, boot_s=3.0)
        head, kind = len(definitions()), written.KINDS["GPS"][0]
        if gps:  # a minute later by the GPS week
            second = [
                r if r[2] != kind else r[:13] + struct.pack("<I", struct.unpack_from("<I", r, 13)[0] + 60_000) + r[17:]
                for r in second
            ]
        else:
            first, second = ([r for r in rows if r[2] != kind] for rows in (first, second))
        log = dataflash(tmp_path / "a.bin", *first[head:], *second[head:])
        assert np.all(np.diff(log.position.time_s) >= 0)
        assert len(log.position.time_s) == 102
        begin = 160.0 if gps else 105.0 + 3600.0
        assert log.position.time_s[51] == pytest.approx(begin, abs=0.01)
        assert any("started anew" in note for note in log.notes)

    def test_px4(self, tmp_path):
        first, second = flying(), flying(begin=3.0)
        topics = {name: (fields, [*rows, *second[name][1]]) for name, (fields, rows) in first.items()}
        log = read_log(ulog(tmp_path / "a.ulg", topics, info={"unsorted": 1}))
        assert np.all(np.diff(log.position.time_s) >= 0)
        assert log.position.time_s[50] == pytest.approx(104.9 + 3600.0, abs=0.01)
        assert any("started anew" in note for note in log.notes)

    def test_subtitles(self, tmp_path):
        one = "".join(f"{i}\n00:00:{i:02d},000 --> 00:00:{i:02d},900\n[latitude: 41.{i:02d}] [longitude: 2.1]\n\n"
                      for i in range(20))  # fmt: skip
        (tmp_path / "a.srt").write_text(one + one)
        log = read_log(tmp_path / "a.srt")
        assert log.position.time_s[20] == pytest.approx(19 + 3600.0)
        assert any("another recording" in note for note in log.notes)


class TestValidity:
    def test_gps_without_a_fix_is_no_position(self, tmp_path):
        """[MAV] GPS_RAW_INT.fix_type below 3; no other message tells a position."""
        link = Link()
        for i in range(100):
            fix = 2 if 40 <= i < 55 else 3
            message = mav.MAVLink_gps_raw_int_message(
                round((100 + i / 10) * 1e6),
                fix,
                round(LAT * 1e7),
                round(LON * 1e7) + 100 * i,
                100_000,
                80,
                90,
                0,
                0,
                12,
            )
            link.send(message, record_s=RECORD_EPOCH_S + i / 10)
            link.send(
                mav.MAVLink_attitude_message(100_000 + 100 * i, 0, 0, 0, 0, 0, 0), record_s=RECORD_EPOCH_S + i / 10
            )
        log = tlog(tmp_path / "a.tlog", link)
        assert log.position.source == "GPS_RAW_INT"
        assert int(log.position.valid.sum()) == 85
        assert any("15 of 100 positions" in note and "103.9 to 105.5" in note for note in log.notes)

    def test_dataflash_gps_without_a_fix_is_none(self, tmp_path):
        """[AP] GPS.Status below 3."""
        rows = [
            record("GPS", 100_000_000 + 200_000 * i, 0, 1 if 10 <= i < 20 else 4, 200 * i, 2300, 14, 80, LAT * 1e7,
                   LON * 1e7 + 100 * i, 10000, 10, 90, 0, 0, 1)
            for i in range(50)
        ]  # fmt: skip
        log = dataflash(tmp_path / "a.bin", *rows)
        assert (log.position.source, int(log.position.valid.sum())) == ("GPS", 40)
        assert any("10 of 50 positions" in note for note in log.notes)

    @pytest.mark.parametrize("flag", ["lat_lon_valid", "alt_valid"])
    def test_px4_flags(self, tmp_path, flag):
        topics = flying(**{flag: lambda i: not 20 <= i < 30})
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        assert int(log.position.valid.sum()) == 40
        assert any("10 of 50 positions" in note for note in log.notes)

    def test_angles_under_an_encoder_error_are_none(self, tmp_path):
        """[MAV] GIMBAL_DEVICE_ERROR_FLAGS_ENCODER_ERROR = 8."""
        say = lambda i, t, ms: [(device(ms, turned(90, -30), 64, failure=8 * (i < 50)), 154)]  # noqa: E731
        log = tlog(tmp_path / "a.tlog", swaying_link(say))
        assert int(log.gimbal.valid.sum()) == 150


class TestFrames:
    @pytest.mark.parametrize("flags", [32 | 12, 12, 16 | 12])
    def test_a_servo_gimbal_that_flags_a_lock(self, tmp_path, flags):
        """[AP] 4.6: body-frame servo angles under ROLL_LOCK | PITCH_LOCK, with YAW_LOCK or not."""
        log = tlog(tmp_path / "a.tlog", swaying_link(lambda i, t, ms: [(device(ms, servo(t), flags, number=1), 1)]))
        assert set(log.gimbal.frame) == {BODY}
        assert any("undo the vehicle's own" in note and "degrees apart" in note for note in log.notes)
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 1:], [[-30, 0]] * 2, atol=0.3)

    @pytest.mark.parametrize("form", ["tlog", "ulog"])
    def test_servos_whose_flags_change_on_the_way(self, tmp_path, form):
        """Yaw follows, then is locked: what the flags say of roll and pitch is held against the angles all the same."""
        flags = lambda t: 12 | (32 if t < 10 else 64)  # noqa: E731
        if form == "tlog":
            log = tlog(
                tmp_path / "a.tlog", swaying_link(lambda i, t, ms: [(device(ms, servo(t), flags(t), number=1), 1)])
            )
        else:
            times = np.arange(100, 120, 0.1)
            topics = {
                **flying(seconds=20.0),
                "vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": turned(*swaying(t - 100))} for t in times]),
                "gimbal_device_attitude_status": gimbal_topic([(t, servo(t - 100), flags(t - 100), 0) for t in times]),
            }
            log = read_log(ulog(tmp_path / "a.ulg", topics))
        assert set(log.gimbal.frame) == {BODY}
        np.testing.assert_allclose(facing(log, [103.0, 117.0])[:, 1:], [[-30, 0]] * 2, atol=0.3)

    def test_yaw_whose_flags_change_is_held_part_by_part(self, tmp_path):
        """The first half says north, and turns back against the vehicle; the second says heading, and is."""

        def say(i, t, ms):
            yaw, flag = (40 - swaying(t)[0], 64) if t < 20 else (5.0, 32)
            return [(device(ms, turned(yaw, -30), 12 | flag), 154)]

        log = tlog(tmp_path / "a.tlog", swaying_link(say, seconds=40))
        assert set(log.gimbal.frame) == {HEADING}
        want = [40.0, swaying(30.0)[0] + 5]
        np.testing.assert_allclose(facing(log, [110.0, 130.0])[:, 0], want, atol=0.3)

    @pytest.mark.parametrize("form", ["tlog", "ulog"])
    def test_px4_s_own_outputs(self, tmp_path, form):
        """[PX4] gimbal/output_rc.cpp flags what it sends its outputs as locked in all axes (30), and it is against the
        vehicle; angles that never move are commands: whether the camera levels itself nobody says."""
        if form == "tlog":
            say = lambda i, t, ms: [(device(ms, turned(10, -30), 30, number=1), 1)]  # noqa: E731
            log = tlog(tmp_path / "a.tlog", swaying_link(say, autopilot=12))
        else:
            times = np.arange(100, 120, 0.1)
            topics = {
                **flying(seconds=20.0),
                "vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": turned(*swaying(t - 100))} for t in times]),
                "gimbal_device_attitude_status": gimbal_topic([(t, turned(10, -30), 30, 0) for t in times]),
            }
            log = read_log(ulog(tmp_path / "a.ulg", topics))
        want = [swaying(t)[0] + 10 for t in (3.0, 7.0)]
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 0], want, atol=0.3)
        assert any("PX4's own yaw counts from the vehicle's heading" in note for note in log.notes)
        assert any("as commands do not" in note and "degrees apart" in note for note in log.notes)

    def test_a_gimbal_s_own_yaw_lock_is_believed(self, tmp_path):
        """[PX4] received_from_mavlink: the same flags of a gimbal that PX4 only heard."""
        times = np.arange(100, 120, 0.1)
        fields, rows = gimbal_topic([(t, turned(10, -30), 30, 0) for t in times])
        heard = ({**fields, "received_from_mavlink": "b"}, [{**row, "received_from_mavlink": True} for row in rows])
        topics = {
            **flying(seconds=20.0),
            "vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": turned(*swaying(t - 100))} for t in times]),
            "gimbal_device_attitude_status": heard,
        }
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        np.testing.assert_allclose(facing(log, [103.0, 107.0]), [[10, -30, 0]] * 2, atol=0.3)
        assert not any("commands" in note for note in log.notes)

    def test_mnt_that_never_moves(self, tmp_path):
        """[AP] MNT of a gimbal without feedback says what was asked for."""
        records = []
        for i in range(200):
            us, (yaw, pitch, roll) = 100_000_000 + 100_000 * i, swaying(i / 10)
            records.append(record("ATT", us, 0, round(100 * roll), 0, round(100 * pitch), 0, round(100 * yaw), 0, 0))
            records.append(record("POS", us, LAT * 1e7, LON * 1e7, 100, 0, 0))
            records.append(record("MNT", us, 0, 0, -30, 0, np.nan, 0, 0))
        log = dataflash(tmp_path / "a.bin", *records)
        assert any("MNT: its angles never move" in note and "degrees apart" in note for note in log.notes)

    def test_of_a_long_series_a_part_tells(self, monkeypatch, tmp_path):
        """Runs of neighbours, evenly over it, and not every n-th sample: unrest is from sample to sample."""
        monkeypatch.setattr("pipeline.telemetry.gimbals.frames.RUN_ROWS", 4)
        log = tlog(tmp_path / "a.tlog", swaying_link(lambda i, t, ms: [(device(ms, servo(t), 44, number=1), 1)]))
        assert set(log.gimbal.frame) == {BODY}
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 1:], [[-30, 0]] * 2, atol=0.3)

    def test_a_stabilised_one_is_as_it_says(self, tmp_path):
        say = lambda i, t, ms: [(device(ms, turned(swaying(t)[0] + 10, -30), 64 | 12), 154)]  # noqa: E731
        log = tlog(tmp_path / "a.tlog", swaying_link(say))
        assert set(log.gimbal.frame) == {EARTH}
        assert not any("GIMBAL_DEVICE" in note for note in log.notes)

    def test_mnt_of_servos(self, tmp_path):
        records = []
        for i in range(200):
            t, us = i / 10, 100_000_000 + 100_000 * i
            yaw, pitch, roll = swaying(t)
            ypr = np.degrees(rotation.yaw_pitch_roll(servo(t)))
            records.append(record("ATT", us, 0, round(100 * roll), 0, round(100 * pitch), 0, round(100 * yaw), 0, 0))
            records.append(record("POS", us, LAT * 1e7, LON * 1e7, 100, 0, 0))
            records.append(record("MNT", us, 0, ypr[2], ypr[1], ypr[0], ypr[0] + yaw, 0, 0))
        log = dataflash(tmp_path / "a.bin", *records)
        assert set(log.gimbal.frame) == {BODY}
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 1:], [[-30, 0]] * 2, atol=0.3)

    def test_px4_flags_of_servos(self, tmp_path):
        times = np.arange(100, 115, 0.1)
        topics = {
            **flying(seconds=15.0),
            "vehicle_attitude": ({"q[4]": "q"}, [{"t": t, "q[4]": turned(*swaying(t - 100))} for t in times]),
            "gimbal_device_attitude_status": gimbal_topic([(t, servo(t - 100), 32 | 12, 0) for t in times]),
        }
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        assert set(log.gimbal.frame) == {BODY}
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 1:], [[-30, 0]] * 2, atol=0.3)

    @pytest.mark.parametrize(
        ("flags", "yaw", "frame"),
        [
            (32, lambda heading: heading + 5, EARTH),  # says heading, follows the vehicle as one against north does
            (64, lambda heading: 40 - heading, HEADING),  # says north, turns back as one that is locked does
            (32, lambda heading: 5.0, HEADING),
            (64, lambda heading: heading + 5, EARTH),
        ],
    )
    def test_yaw_is_held_against_the_heading(self, tmp_path, flags, yaw, frame):
        say = lambda i, t, ms: [(device(ms, turned(yaw(swaying(t)[0]), -30), flags | 12), 154)]  # noqa: E731
        assert set(tlog(tmp_path / "a.tlog", swaying_link(say)).gimbal.frame) == {frame}

    @pytest.mark.parametrize(("drift", "turned_by"), [(20.0, 0.0), (0.2, 0.2)])
    def test_a_gimbal_with_a_north_of_its_own(self, tmp_path, drift, turned_by):
        """[MAV] delta_yaw: yaw in its earth frame minus yaw in the vehicle frame."""

        def say(i, t, ms):
            heading = swaying(t)[0] - drift  # as the gimbal sees it
            return [(device(ms, turned(heading + 15, -30), 64 | 12, delta_yaw=np.radians(heading)), 154)]

        log = tlog(tmp_path / "a.tlog", swaying_link(say))
        yaw = [swaying(t)[0] + 15 for t in (3.0, 7.0)]
        np.testing.assert_allclose(facing(log, [103.0, 107.0])[:, 0], np.array(yaw) - turned_by, atol=0.3)
        assert any("delta_yaw" in note for note in log.notes) == (drift > 1)

    @pytest.mark.parametrize(
        ("absolute", "frame", "yaw"), [(40.0, EARTH, 40.0), (float("nan"), HEADING, 105.0), (0.0, HEADING, 105.0)]
    )
    def test_mount_orientation(self, tmp_path, absolute, frame, yaw):
        """[MAV] MOUNT_ORIENTATION: yaw against the vehicle, yaw_absolute against north where it is told."""
        link = Link()
        fly(link, seconds=5, heading_deg=lambda t: 90.0)
        for i in range(50):
            message = mav.MAVLink_mount_orientation_message(100_000 + 100 * i, 0, -30, 15, absolute)
            link.send(message, record_s=RECORD_EPOCH_S + i / 10 + 0.03)
        log = tlog(tmp_path / "a.tlog", link)
        assert set(log.gimbal.frame) == {frame}
        np.testing.assert_allclose(facing(log, [102.0])[0], [yaw, -30, 0], atol=1e-3)

    def test_mount_status_is_in_hundredths_of_a_degree(self, tmp_path):
        """[MAV] MOUNT_STATUS: pointing_a pitch, b roll, c yaw, centidegrees; it has no time of its own."""
        link = Link()
        fly(link, seconds=5, heading_deg=lambda t: 90.0)
        for i in range(50):
            message = mav.MAVLink_mount_status_message(0, 0, -3000, 200, 1500, 0)
            link.send(message, record_s=RECORD_EPOCH_S + i / 10 + 0.03)
        log = tlog(tmp_path / "a.tlog", link)
        np.testing.assert_allclose(facing(log, [102.0])[0], [105, -30, 2], atol=1e-3)


class TestHeights:
    def link(self, ellipsoid_mm, *parameters):
        link = Link()
        for i in range(50):
            now = RECORD_EPOCH_S + i / 10
            place = (round(LAT * 1e7), round(LON * 1e7) + 100 * i)
            for message in (
                mav.MAVLink_global_position_int_message(100_000 + 100 * i, *place, 100_000, 20_000, 0, 0, 0, 0),
                mav.MAVLink_gps_raw_int_message(
                    round((100 + i / 10) * 1e6),
                    3,
                    *place,
                    100_000,
                    80,
                    90,
                    0,
                    0,
                    12,
                    ellipsoid_mm,
                    900,
                    1500,
                    300,
                    0,
                    0,
                ),
                *parameters,
            ):
                link.send(message, record_s=now)
        return link

    @pytest.mark.parametrize(
        ("ellipsoid_mm", "height_m", "word"),
        [
            (83_100, 83.1, ""),
            (100_000, 83.1, "it says nothing"),
            (75_000, 75.0, "m apart; the log's own is used"),
            (0, 83.1, ""),
        ],
    )
    def test_a_log_s_own_undulation_is_held_against_egm96(self, tmp_path, ellipsoid_mm, height_m, word):
        log = tlog(tmp_path / "a.tlog", self.link(ellipsoid_mm))
        assert log.position.height_m[0] == pytest.approx(height_m, abs=0.5)
        assert any(word in note for note in log.notes) if word else not log.notes

    @pytest.mark.parametrize("options", [0.0, 16.0])
    def test_a_parameter_that_changes_what_heights_mean(self, tmp_path, options):
        """[AP] GPS_DRV_OPTIONS bit 4: ellipsoid height instead of AMSL."""
        said = mav.MAVLink_param_value_message(b"GPS_DRV_OPTIONS", options, 9, 1, 0)
        log = tlog(tmp_path / "a.tlog", self.link(100_000, said))
        assert log.position.height_m[0] == pytest.approx(100.0 if options else 83.1, abs=0.5)
        records = [record("PARM", 100_000_000, b"GPS_DRV_OPTIONS", options)]
        onboard = dataflash(tmp_path / "a.bin", *records, *dataflash_records()[len(definitions()) :])
        assert onboard.position.height_m[0] == pytest.approx(100.0 if options else 83.1, abs=0.5)

    def test_dataflash_equal_heights(self, tmp_path):
        records = dataflash_records()[len(definitions()) :]
        records += [record("GPA", 100_000_000 + 200_000 * i, 0, 100, 1, 1, 100.0) for i in range(40)]
        log = dataflash(tmp_path / "a.bin", *records)
        assert log.position.height_m[0] == pytest.approx(83.1, abs=0.5)
        assert any("GPA.AEl" in note and "it says nothing" in note for note in log.notes)

    def test_px4_equal_heights(self, tmp_path):
        log = read_log(ulog(tmp_path / "a.ulg", flying(alt_ellipsoid=lambda i: 100.0)))
        assert log.position.height_m[0] == pytest.approx(83.1, abs=0.5)
        assert any("it says nothing" in note for note in log.notes)

    @pytest.mark.parametrize(("absolute", "datum"), [(117.0, "ellipsoid"), (-124.7, "home")])
    def test_a_take_off_where_no_land_is(self, tmp_path, absolute, datum):
        (tmp_path / "a.srt").write_text("".join(
            f"{i}\n00:00:{i:02d},000 --> 00:00:{i:02d},900\n"
            f"[latitude: 41.{i:02d}] [longitude: 2.1] [rel_alt: 5.4 abs_alt: {absolute}]\n\n"
            for i in range(5)
        ))  # fmt: skip
        log = read_log(tmp_path / "a.srt")
        assert log.position.datum == datum
        assert any("no land" in note for note in log.notes) == (datum == "home")

    def test_an_altitude_that_repeats_the_height_above_take_off(self, tmp_path):
        """rel_alt written twice: one row that differs by a metre is a take-off place at sea level."""
        rows = [
            f"{i}\n00:00:{i:02d},000 --> 00:00:{i:02d},900\n[latitude: 41.{i:02d}] [longitude: 2.1]" for i in range(5)
        ]
        for last, datum in ((14.0, "home"), (15.0, "ellipsoid")):
            heights = [10.0, 11.0, 12.0, 13.0, 14.0], [10.0, 11.0, 12.0, 13.0, last]
            said = (f"{row} [rel_alt: {r} abs_alt: {a}]\n" for row, r, a in zip(rows, *heights, strict=True))
            (tmp_path / "a.srt").write_text("\n".join(said))
            log = read_log(tmp_path / "a.srt")
            assert log.position.datum == datum
            assert any("repeats the height" in note for note in log.notes) == (datum == "home")


class TestSigmas:
    def subtitles(self, tmp_path, lat, *, hz=10, seconds=10, more=""):
        """Subtitles with latitude texts by time."""
        rows = []
        for i in range(hz * seconds):
            t = i / hz
            cue = f"00:00:{int(t):02d},{round(1000 * (t % 1)):03d}"
            rows.append(f"{i}\n{cue} --> {cue}\n[latitude: {lat(t)}] [longitude: +2.2500000] {more}\n")
        (tmp_path / "a.srt").write_text("\n".join(rows))
        return read_log(tmp_path / "a.srt")

    @pytest.mark.parametrize(("digits", "least_m", "most_m"), [(4, 3.2, 4.5), (7, 0.99, 1.01)])
    def test_digits_are_part_of_the_sigma(self, tmp_path, digits, least_m, most_m):
        """Four decimals of a degree are 11 m: 3.2 m, one sigma."""
        log = self.subtitles(tmp_path, lambda t: f"{41.0 + 1.234567e-4 * t:.{digits}f}", more="[rel_alt: 5.0]")
        assert least_m < log_sigma(log).position_m < most_m

    def test_a_barometer_is_no_survey(self, tmp_path):
        log = self.subtitles(tmp_path, lambda t: f"{41.0 + 1e-4 * t:.7f}", more="[abs_alt: 50.0]")
        assert log_sigma(log).position_bias_m > 30

    def test_a_staircase_is_a_sample_a_step(self, tmp_path):
        """Places of 5 Hz in cues of 30 Hz, 10 m/s to the north."""
        log = self.subtitles(tmp_path, lambda t: f"{41.0 + np.floor(5 * t + 1e-6) / 5 * 9e-5:.7f}", hz=30,
                             more="[rel_alt: 5.0] [gb_yaw: 0 gb_pitch: 0 gb_roll: 0]")  # fmt: skip
        assert int(log.position.valid.sum()) == 50
        assert any("renewed at 5.0 Hz" in note for note in log.notes)
        keep = log.position.valid
        north = (np.degrees(log.position.lat_rad[keep]) - 41.0) / 9e-5
        np.testing.assert_allclose(north, log.position.time_s[keep], atol=0.02)

    def test_two_links_of_one_vehicle_are_no_staircase(self, tmp_path):
        link = Link()
        fly(link, seconds=5)
        fly(link, seconds=5, record_s=RECORD_EPOCH_S + 0.01)
        log = tlog(tmp_path / "a.tlog", link)
        assert not log.position.repeated.any()
        assert not any("renewed" in note for note in log.notes)

    def test_a_vehicle_that_stands_keeps_its_samples(self, tmp_path):
        stands = lambda t: 41.0 + np.floor(5 * min(t, 2.0) + 1e-6) / 5 * 9e-5  # noqa: E731
        log = self.subtitles(tmp_path, lambda t: f"{stands(t):.7f}", hz=30, more="[rel_alt: 5.0]")
        assert np.diff(log.position.time_s[log.position.valid]).max() < 0.5

    def test_two_antennas_say_how_well_they_know_the_heading(self, tmp_path):
        """[MAV] GPS_RAW_INT.hdg_acc counts only where yaw is told: 0 is not provided, 65535 not working."""
        for yaw, heading_rad in ((9000, np.radians(2.0)), (0, np.nan), (65535, np.nan)):
            link = Link()
            for i in range(20):
                place = (round(LAT * 1e7), round(LON * 1e7), 100_000)
                message = mav.MAVLink_gps_raw_int_message(
                    round((100 + i / 10) * 1e6), 3, *place, 80, 90, 0, 0, 12, 83_100, 900, 1500, 300, 200_000, yaw
                )
                link.send(message, record_s=RECORD_EPOCH_S + i / 10)
            log = tlog(tmp_path / f"{yaw}.tlog", link)
            assert log.accuracy.heading_rad == pytest.approx(heading_rad, nan_ok=True)
            assert log_sigma(log).attitude_bias_rad == pytest.approx(np.radians(2.0 if yaw == 9000 else 0.5))


class TestClocks:
    def test_utc_that_was_set_on_the_way(self, tmp_path):
        """A real-time clock a month off for most of the log, then GPS."""
        link = Link()
        fly(link, seconds=20, utc=False)
        for i in range(200):
            wrong = -2_592_000.0 if i < 150 else 0.0
            message = mav.MAVLink_system_time_message(
                round((BOOT_UTC_S + 100 + i / 10 + wrong) * 1e6), 100_000 + 100 * i
            )
            link.send(message, record_s=RECORD_EPOCH_S + i / 10 + 0.03)
        log = tlog(tmp_path / "a.tlog", link)
        assert utc_at(log, 105.0) == pytest.approx(BOOT_UTC_S + 105.0, abs=0.01)
        assert any("2592000.0 s behind from log time 100.0 to 114.9" in note for note in log.notes)

    def read_clock(self, tmp_path, form, utc):
        """A minute's log in which `utc(t)` is what the receiver says, POSIX seconds, at log time 100 s + t."""
        if form == "tlog":  # [MAV] SYSTEM_TIME.time_unix_usec
            link = Link()
            fly(link, seconds=60, utc=False)
            for i in range(600):
                message = mav.MAVLink_system_time_message(round(utc(i / 10) * 1e6), 100_000 + 100 * i)
                link.send(message, record_s=RECORD_EPOCH_S + i / 10 + 0.03)
            return tlog(tmp_path / "a.tlog", link)
        if form == "ulog":  # [PX4] sensor_gps.time_utc_usec
            rows = [{"t": 100 + i / 10, "time_utc_usec": round(utc(i / 10) * 1e6), "fix_type": 3} for i in range(600)]
            topics = {
                **flying(seconds=60.0),
                "vehicle_gps_position": ({"time_utc_usec": "u64", "fix_type": "u1"}, rows),
            }
            return read_log(ulog(tmp_path / "a.ulg", topics))
        rows = []  # [AP] GPS.GWk, GPS.GMS: 18 s ahead of UTC since 2017
        for i in range(300):
            week, second = divmod(utc(i / 5) - 315_964_800 + 18, 604_800)
            rows.append(record("GPS", 100_000_000 + 200_000 * i, 0, 4, round(1000 * second), week, 14, 80, LAT * 1e7,
                               LON * 1e7 + 100 * i, 10000, 10, 90, 0, 0, 1))  # fmt: skip
        return dataflash(tmp_path / "a.bin", *rows)

    @pytest.mark.parametrize("form", ["tlog", "ulog", "dataflash"])
    @pytest.mark.parametrize("late", [1.0, -2.0])
    def test_leap_seconds_that_a_receiver_learns_late(self, tmp_path, form, late):
        """Its UTC steps by whole seconds when the almanac arrives: what comes after holds."""
        log = self.read_clock(tmp_path, form, lambda t: 1.71e9 + t + late * (t < 40))
        assert utc_at(log, 105.0) == pytest.approx(1.71e9 + 5.0, abs=0.01)
        assert any(f"was {abs(late):.1f} s {'ahead' if late > 0 else 'behind'}" in note for note in log.notes)

    def test_a_clock_that_drifts_was_not_set(self, tmp_path):
        """An old quartz, 0.1 % fast: no step in it, and its rate is told."""
        log = self.read_clock(tmp_path, "tlog", lambda t: 1.71e9 + 1.001 * t)
        assert (log.utc.steps, log.utc.rate) == ((), pytest.approx(1.001, abs=1e-5))

    @pytest.mark.parametrize("form", ["tlog", "ulog", "dataflash"])
    @pytest.mark.parametrize(("rolled", "believed"), [(1024, False), (2048, False), (1024, True)])
    def test_a_week_that_rolled_over_is_told(self, tmp_path, form, rolled, believed):
        """2023 and 2026 by a receiver that counts weeks in ten bits: 2004 is thrown away, 2006 is doubted; both say
        what they would mean."""
        true = 1.78e9 if believed else 1.7e9
        log = self.read_clock(tmp_path, form, lambda t: true + t - rolled * 604_800)
        assert (log.utc is not None) == believed
        assert any(f"rolled over would mean {'2026-05-28' if believed else '2023-11-14'}" in n for n in log.notes)

    def test_a_log_that_loses_time_runs_at_its_own_rate(self, tmp_path):
        """8.3 s in 100 s of log time, as of a real plane whose loop could not keep up."""
        records = []
        for i in range(500):
            t = i / 5
            records.append(record("GPS", 100_000_000 + round(t * 1e6), 0, 4, 100_000 + round(1083 * t), 2300, 14, 80,
                                  LAT * 1e7, LON * 1e7 + 100 * i, 10000, 10, 90, 0, 0, 1))  # fmt: skip
        log = dataflash(tmp_path / "a.bin", *records)
        assert log.utc.rate == pytest.approx(1.083, abs=1e-4)
        assert utc_at(log, 200.0) - utc_at(log, 100.0) == pytest.approx(108.3, abs=0.05)
        assert any("8.3 % slow" in note for note in log.notes)
        np.testing.assert_allclose(log_seconds(log, np.array([10.83])), [10.0], atol=1e-2)

    def test_a_quartz_is_left_alone(self, tmp_path):
        log = dataflash(tmp_path / "a.bin", *dataflash_records()[len(definitions()) :])
        seconds = np.array([10.0])
        assert log_seconds(log, seconds) is seconds

    def test_a_log_that_counts_from_1970(self, tmp_path):
        log = read_log(ulog(tmp_path / "a.ulg", flying(begin=1_710_000_100.0)))
        assert resolve_start(log, 1_710_000_102.0, where="w") == 1_710_000_102.0
        assert resolve_start(log, "2024-03-09T16:01:42Z", where="w") == pytest.approx(1_710_000_102.0)

    def test_when_a_px4_vehicle_started(self, tmp_path):
        log = read_log(ulog(tmp_path / "a.ulg", flying(), info={"boot_time_utc_us": 1_710_000_000_000_000}))
        assert utc_at(log, 102.0) == pytest.approx(1_710_000_102.0)
        assert log.utc.source == "boot_time_utc_us"


class TestDefinitions:
    def mended(self, name, **how):
        """The definitions, with one changed."""
        found = []
        for one in definitions():
            kind, length, own, letters, columns = struct.unpack("<3xBB4s16s64s", one)
            if own.rstrip(b"\0") == name.encode():
                length, letters = how.get("length", length), how.get("letters", letters)
                columns = how.get("columns", columns)
            found.append(struct.pack("<3sBB4s16s64s", b"\xa3\x95\x80", kind, length, own, letters, columns))
        return found

    def test_a_declared_length_is_stepped_over(self, tmp_path):
        """[AP] BAR2 of some firmware: letters of another length than declared."""
        records = dataflash_records()[len(definitions()) :]
        head = self.mended("IMU", letters=b"QBffffffffffff")
        (tmp_path / "a.bin").write_bytes(b"".join([*head, *records]))
        log = read_log(tmp_path / "a.bin")
        assert (log.counts["POS"], log.counts["ATT"], log.corrupt_packets) == (101, 101, 0)
        assert any("IMU: definition contradicts itself" in note for note in log.notes)

    @pytest.mark.parametrize("at", [28, 88])
    def test_a_flipped_bit_in_a_field_s_name_or_behind_it_costs_nothing_else(self, tmp_path, at):
        """No text any more where a bit is set high in a letter, or behind the last one: the others are read."""
        broken = [d if d[5:8] != b"POS" else bytes([*d[:at], d[at] ^ 0x80, *d[at + 1 :]]) for d in definitions()]
        (tmp_path / "a.bin").write_bytes(b"".join([*broken, *dataflash_records()[len(definitions()) :]]))
        log = read_log(tmp_path / "a.bin")
        assert (log.counts["POS"], log.corrupt_packets) == (101, 0)
        assert np.degrees(log.position.lat_rad[5]) == pytest.approx(LAT)

    def test_a_definition_that_is_lost_costs_no_other_messages(self, tmp_path):
        """What stands before a message of a kind that nothing defines is whole, and so is a definition before the
        place of the lost one."""
        own = definitions()
        lost = next(i for i, d in enumerate(own) if d[5:8] == b"IMU")
        head = [bytes(89) if i == lost else d for i, d in enumerate(own)]
        (tmp_path / "a.bin").write_bytes(b"".join([*head, *dataflash_records()[len(own) :]]))
        log = read_log(tmp_path / "a.bin")
        assert log.counts["FMT"] == len(own) - 1
        assert {name: log.counts[name] for name in ("POS", "ATT", "GPS", "CAM")} == {
            "POS": 101, "ATT": 101, "GPS": 51, "CAM": 11
        }  # fmt: skip

    def test_fields_that_fit_into_a_longer_message_are_read(self, tmp_path):
        """Letters that leave some of the declared length over."""
        records = [r if r[2] != 132 else r + b"\x07\x07" for r in dataflash_records()[len(definitions()) :]]
        head = self.mended("POS", length=33)
        (tmp_path / "a.bin").write_bytes(b"".join([*head, *records]))
        log = read_log(tmp_path / "a.bin")
        assert (log.counts["POS"], log.corrupt_packets) == (101, 0)
        assert np.degrees(log.position.lat_rad[5]) == pytest.approx(LAT)

    def test_a_length_that_no_message_has_gives_way_to_the_letters(self, tmp_path):
        head = self.mended("POS", length=35)
        (tmp_path / "a.bin").write_bytes(b"".join([*head, *dataflash_records()[len(definitions()) :]]))
        log = read_log(tmp_path / "a.bin")
        assert (log.counts["POS"], log.corrupt_packets) == (101, 0)

    def test_a_later_definition_holds_for_later_messages(self, tmp_path):
        """POS with latitude and longitude exchanged from the second half on."""
        first, later = (dataflash_records(seconds=5, boot_s=b)[len(definitions()) :] for b in (100.0, 105.1))
        swap = lambda r: r[:11] + r[15:19] + r[11:15] + r[19:] if r[2] == 132 else r  # noqa: E731
        again = [d for d in self.mended("POS", columns=b"TimeUS,Lng,Lat,Alt,RelHomeAlt,RelOriginAlt") if d[3] == 132]
        (tmp_path / "a.bin").write_bytes(b"".join([*definitions(), *first, *again, *map(swap, later)]))
        log = read_log(tmp_path / "a.bin")
        assert log.counts["POS"] == 102
        np.testing.assert_allclose(np.degrees(log.position.lat_rad), LAT, atol=1e-6)

    def test_a_damaged_repetition_of_a_definition_changes_nothing(self, tmp_path):
        first, later = (dataflash_records(seconds=5, boot_s=b)[len(definitions()) :] for b in (100.0, 105.1))
        damaged = [bytes([*d[:30], d[30] ^ 2, *d[31:]]) for d in definitions()]
        (tmp_path / "a.bin").write_bytes(b"".join([*definitions(), *first, *damaged, *later]))
        log = read_log(tmp_path / "a.bin")
        assert log.counts["POS"] == 102
        assert len(log.position.time_s) == 102

    def test_px4_trigger_and_feedback_are_one_exposure(self, tmp_path):
        """[PX4] camera_trigger: seq, feedback."""
        rows = [{"t": 101 + i / 10 + 0.012 * feedback, "timestamp_utc": 0, "seq": i, "feedback": bool(feedback)}
                for i in range(20) for feedback in (0, 1)]  # fmt: skip
        topics = {**flying(), "camera_trigger": ({"timestamp_utc": "u64", "seq": "u4", "feedback": "b"}, rows)}
        log = read_log(ulog(tmp_path / "a.ulg", topics))
        np.testing.assert_allclose(log.camera_event_s, 101.012 + np.arange(20) / 10, atol=1e-6)

    @pytest.mark.parametrize(
        ("text", "place"),
        [
            ("GPS(41.500000,2.250000,69.800) BAROMETER(91.2)", (41.5, 2.25, 91.2)),
            ("GPS(2.250000,41.500000,15) BAROMETER:91.2", (41.5, 2.25, 91.2)),
            ("[latitude: +41.500000] [longitude: +2.250000] [rel_alt: +5.0]", (41.5, 2.25, 5.0)),
            ("[latitude: -41.500000] [longitude: -2.250000] [rel_alt: -5.0]", (-41.5, -2.25, -5.0)),
        ],
    )
    @pytest.mark.parametrize("gap", ["\n", "\n\n", "\r\n"])
    def test_dialects_of_subtitles(self, tmp_path, text, place, gap):
        rows = [f"{i}\n00:00:{i:02d},000 --> 00:00:{i:02d},900\n{text}" for i in range(6)]
        (tmp_path / "a.srt").write_bytes(gap.join(rows).encode())
        position = read_log(tmp_path / "a.srt").position
        assert len(position.time_s) == 6
        found = (np.degrees(position.lat_rad[0]), np.degrees(position.lon_rad[0]), position.height_m[0])
        assert found == pytest.approx(place)
