"""Logs that the tests wrote come back as they were: positions, attitudes, clocks, events, and who sent what."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.geometry import rotation
from pipeline.telemetry import (
    Mount,
    camera_poses,
    covered,
    event_times,
    first_position,
    log_sigma,
    log_span,
    read_log,
    resolve_start,
    utc_at,
)
from pipeline.telemetry.clocks import boot_clock as clocks
from pipeline.telemetry.dataflash.flight import dataflash_flight
from pipeline.telemetry.dataflash.messages.read import read_dataflash_text
from pipeline.telemetry.log.flight_log import BODY, HEADING
from pipeline.telemetry.mavlink.packets import fast as mavlink_fast
from pipeline.telemetry.mavlink.packets.fast import read_mavlink_fast
from pipeline.telemetry.mavlink.packets.plain import dialect_module
from tests.scenes.logs import (
    BOOT_UTC_S,
    PLACE,
    RECORD_EPOCH_S,
    Link,
    dataflash,
    dataflash_records,
    fly,
    tlog,
)


def poses(log, time, mount=Mount(), lever=(0.0, 0.0, 0.0)):  # noqa: B008
    time = np.asarray(time, float)
    return camera_poses(
        log, camera="uav1", frame=np.arange(len(time)), log_time_s=time, mount=mount, lever_arm_m=np.array(lever),
        origin=PLACE, where="flight.toml, cameras.uav1.telemetry",
    )  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return read_log(tlog(tmp_path_factory.mktemp("logs") / "a.tlog"))


@pytest.fixture(scope="module")
def onboard(tmp_path_factory):
    return read_log(dataflash(tmp_path_factory.mktemp("logs") / "a.bin"))


class TestTlog:
    def test_the_flight_comes_back_on_boot_time(self, flight):
        track = poses(flight, [100.0, 101.05, 109.99])
        np.testing.assert_allclose(track.position_enu_m[:, 0], [0.0, 10.5, 99.9], atol=0.02)
        np.testing.assert_allclose(track.position_enu_m[:, 1:], 0.0, atol=0.02)
        ypr = np.degrees(rotation.camera_yaw_pitch_roll(track.enu_from_cam))
        np.testing.assert_allclose(ypr[:, 0], [90.0, 93.15, 119.97], atol=1e-3)
        np.testing.assert_allclose(ypr[:, 1:], [np.degrees([-0.02, 0.01])] * 3, atol=1e-3)

    def test_heights_are_above_the_ellipsoid_by_the_receivers_own_pair(self, flight):
        assert flight.position.datum == "ellipsoid"
        assert "GPS_RAW_INT" in flight.position.height_from
        assert first_position(flight).height_m == pytest.approx(PLACE.height_m, abs=1e-3)

    def test_without_a_pair_the_geoid_model_brings_heights_to_the_ellipsoid(self, tmp_path):
        log = read_log(tlog(tmp_path / "b.tlog", own_undulation=False))
        assert "EGM96" in log.position.height_from
        assert first_position(log).height_m == pytest.approx(PLACE.height_m + 20 - 16.9, abs=1.0)

    def test_the_ground_station_is_not_the_vehicle(self, flight):
        assert (flight.system, flight.component) == (1, 1)
        assert flight.counts["HEARTBEAT"] == 22
        assert flight.utc.outliers == 0

    def test_sigmas_come_from_the_receiver(self, flight):
        assert (flight.accuracy.horizontal_m, flight.accuracy.vertical_m) == (0.9, 1.5)
        assert log_sigma(flight).position_bias_m == pytest.approx(np.sqrt((0.9**2 + 1.5**2) / 2))
        assert flight.accuracy.source == "GPS_RAW_INT"

    def test_the_vehicle_with_most_positions_is_taken_and_another_can_be_named(self, tmp_path):
        link = Link()
        fly(link, seconds=5, system=7, heading_deg=lambda t: 0.0)
        fly(link, seconds=10, system=3)
        path = link.save(tmp_path / "two.tlog")
        log = read_log(path)
        assert log.system == 3
        assert any("vehicles 7 are in the log too" in note for note in log.notes)
        other = read_log(path, system=7)
        assert len(other.position.time_s) == 51
        with pytest.raises(InputFileError, match=r"system 9.*systems in it: \[3, 7\]"):
            read_log(path, system=9)

    def test_after_a_reboot_log_time_goes_on_by_the_recorders_clock(self, tmp_path):
        link = Link()
        fly(link, seconds=5, boot_s=100.0)
        fly(link, seconds=5, boot_s=3.0, record_s=RECORD_EPOCH_S + 60.0)
        log = read_log(link.save(tmp_path / "reboot.tlog"))
        assert len(log.position.time_s) == 102
        assert log.position.time_s[51] == pytest.approx(160.0, abs=0.01)
        assert any("started anew" in note for note in log.notes)
        assert not covered(log, np.array([130.0]), mount=Mount(), lever_arm_m=np.zeros(3))[0]

    def test_a_boot_clock_that_runs_over_is_no_reboot(self, tmp_path):
        """Milliseconds of 32 bits begin anew after 49.7 days."""
        link, over_s = Link(), (1 << 32) / 1000
        fly(link, seconds=5, boot_s=over_s - 6.0)
        fly(link, seconds=5, boot_s=0.0, record_s=RECORD_EPOCH_S + 6.0)
        log = read_log(link.save(tmp_path / "over.tlog"))
        assert log.position.time_s[51] == pytest.approx(over_s, abs=0.01)
        assert any("of 32 bits ran over" in note for note in log.notes)

    def test_a_late_packet_is_no_reboot(self, tmp_path):
        link = Link()
        fly(link, seconds=5)
        link.packets[60], link.packets[90] = link.packets[90], link.packets[60]
        link.bytes = bytearray(b"".join(link.packets))
        log = read_log(link.save(tmp_path / "late.tlog"))
        assert not any("anew" in note for note in log.notes)
        assert np.all(np.diff(log.position.time_s) >= 0)

    def test_recorder_times_that_lie_do_no_harm(self, tmp_path):
        link = Link()
        fly(link, seconds=10)
        mount = mav.MAVLink_mount_status_message(0, 0, -3000, 0, 100, 0)
        for i in range(0, len(link.packets), 10):
            link.send(mount, record_s=RECORD_EPOCH_S + 5.0)
            link.packets.insert(i, link.packets.pop())
        lies = [bytes([p[0] ^ 1]) + p[1:] if i % 7 == 0 else p for i, p in enumerate(link.packets)]
        log = read_log_of(tmp_path / "lies.tlog", b"".join(lies))
        assert log.record_clock.epoch_s - log.record_clock.log_epoch_s == pytest.approx(RECORD_EPOCH_S - 100, abs=0.1)
        assert log.record_clock.outliers > 10
        seen = log.gimbal.time_s[np.isfinite(log.gimbal.time_s)]
        assert seen.min() > 99
        assert seen.max() < 111

    def test_a_raw_capture_has_no_recorder_but_the_same_flight(self, tmp_path, flight):
        link = Link(stamped=False)
        fly(link)
        log = read_log(link.save(tmp_path / "a.mavlink"))
        assert log.format == "mavlink"
        assert log.record_clock is None
        np.testing.assert_array_equal(log.position.time_s, flight.position.time_s)
        np.testing.assert_array_equal(log.position.lon_rad, flight.position.lon_rad)

    def test_corrupt_packets_are_counted_and_never_used(self, tmp_path):
        link = Link()
        fly(link, seconds=10)
        broken = [bytearray(p) for p in link.packets]
        for i in range(5, 300, 10):
            broken[i][-4] ^= 0x10
        log = read_log_of(tmp_path / "broken.tlog", b"".join(broken))
        assert log.corrupt_packets == 30
        assert sum(log.counts.values()) == len(link.packets) - 30

    def test_a_fixed_gap_is_refused_by_name(self, tmp_path):
        link = Link()
        fly(link, seconds=3)
        fly(link, seconds=3, boot_s=110.0, record_s=RECORD_EPOCH_S + 10)
        log = read_log(link.save(tmp_path / "gap.tlog"))
        with pytest.raises(InputFileError, match=r"no sample between 103.000 and 110.000 s.*frame 1 at 105.000"):
            poses(log, [102.0, 105.0])
        seen = covered(log, np.array([99.0, 102.0, 105.0, 111.0, np.nan]), mount=Mount(), lever_arm_m=np.zeros(3))
        np.testing.assert_array_equal(seen, [False, True, False, True, False])

    def test_nothing_is_extrapolated(self, flight):
        with pytest.raises(InputFileError, match=r"2 of 3 frames lie outside.*frame 1 at 110.500.*100.000 to 110.000"):
            poses(flight, [105.0, 110.5, 111.0])
        with pytest.raises(InputFileError, match="another day"):
            poses(flight, [90000.0, 90001.0])
        assert log_span(flight) == (100.0, 110.0)

    def test_a_gimbal_that_is_not_in_the_log_is_named(self, flight):
        with pytest.raises(InputFileError, match="GIMBAL_DEVICE_ATTITUDE_STATUS, MOUNT_ORIENTATION or MOUNT_STATUS"):
            poses(flight, [105.0], Mount(gimbal=True))

    def test_missing_attitude_and_position_are_named(self, tmp_path):
        link = Link()
        for i in range(5):
            link.send(mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), record_s=RECORD_EPOCH_S + i)
        log = read_log(link.save(tmp_path / "bare.tlog"))
        with pytest.raises(InputFileError, match="expected GLOBAL_POSITION_INT"):
            poses(log, [1.0])
        with pytest.raises(InputFileError, match="no valid position"):
            first_position(log)
        place = mav.MAVLink_global_position_int_message
        for i in range(5):
            link.send(place(i * 1000, 282000000, 1129000000, 0, 0, 0, 0, 0, 0), record_s=RECORD_EPOCH_S + 10 + i)
        with pytest.raises(InputFileError, match="expected ATTITUDE_QUATERNION or ATTITUDE"):
            poses(read_log(link.save(tmp_path / "blind.tlog")), [1.0])

    def test_quaternions_are_preferred_and_a_position_of_zeros_is_none(self, tmp_path):
        link = Link()
        fly(link, seconds=3)
        for i in range(30):
            q = rotation.ned_from_frd(*np.radians([45.0, 0.0, 0.0]))
            ms = round(100_000 + i * 100)
            link.send(mav.MAVLink_attitude_quaternion_message(ms, *q, 0, 0, 0), record_s=RECORD_EPOCH_S + i / 10)
        link.send(
            mav.MAVLink_global_position_int_message(102_950, 0, 0, 0, 0, 0, 0, 0, 0), record_s=RECORD_EPOCH_S + 2.95
        )
        log = read_log(link.save(tmp_path / "q.tlog"))
        assert log.attitude.source == "ATTITUDE_QUATERNION"
        ypr = np.degrees(rotation.camera_yaw_pitch_roll(poses(log, [101.0]).enu_from_cam))
        assert ypr[0, 0] == pytest.approx(45.0, abs=1e-4)
        assert (~log.position.valid).sum() == 1

    def test_progress_is_told(self, tmp_path):
        told: list[float] = []
        read_log(tlog(tmp_path / "p.tlog"), progress=told.append)
        assert told[-1] == 1.0


def read_log_of(path, content):
    path.write_bytes(content)
    return read_log(path)


OWN_DIALECT = """<?xml version="1.0"?><mavlink><version>3</version><messages>
<message id="30" name="ATTITUDE"><description>-</description>
 <field type="uint32_t" name="time_boot_ms">-</field>
 <field type="float" name="roll">-</field><field type="float" name="pitch">-</field>
 <field type="float" name="yaw">-</field><field type="float" name="rollspeed">-</field>
 <field type="float" name="pitchspeed">-</field><field type="float" name="yawspeed">-</field></message>
<message id="41000" name="OWN_THING"><description>-</description>
 <field type="uint32_t" name="time_boot_ms">-</field></message></messages></mavlink>"""


class TestLongLogs:
    """What only very long logs reach, with its bounds brought down."""

    def test_pieces_make_the_same_tables(self, flight, monkeypatch):
        whole = read_mavlink_fast(flight.path)
        monkeypatch.setattr(mavlink_fast, "CHUNK", 7)
        monkeypatch.setattr(mavlink_fast, "SMALL_BYTES", 0)
        pieces = read_mavlink_fast(flight.path)
        assert dict(pieces.counts) == dict(whole.counts)
        assert pieces.tables.keys() == whole.tables.keys()
        for name, table in whole.tables.items():
            same = pieces.tables[name]
            for given in ("place", "record_time_s", "system", "component"):
                np.testing.assert_array_equal(getattr(same, given), getattr(table, given))
            for column in table.columns:
                np.testing.assert_array_equal(same.columns[column], table.columns[column])

    def test_a_part_of_the_readings_knows_the_clock_as_well(self, flight, monkeypatch):
        monkeypatch.setattr(clocks, "MOST_READINGS", 20)
        thin = read_log(flight.path)
        assert thin.record_clock.epoch_s - flight.record_clock.other_s(thin.record_clock.log_epoch_s) == pytest.approx(
            0.0, abs=1e-3
        )
        np.testing.assert_array_equal(thin.position.time_s, flight.position.time_s)
        np.testing.assert_allclose(thin.utc.log_s(BOOT_UTC_S + 105.0), 105.0, atol=0.02)


class TestDialect:
    def test_pymavlinks_common_gives_the_same_flight(self, flight):
        same = read_log(flight.path, dialect="common")
        np.testing.assert_array_equal(same.position.lat_rad, flight.position.lat_rad)
        np.testing.assert_array_equal(same.attitude.ned_from_body, flight.attitude.ned_from_body)

    def test_a_file_of_definitions_adds_the_users_messages(self, tmp_path):
        own = tmp_path / "own.xml"
        own.write_text(OWN_DIALECT)
        messages = dialect_module(str(own))
        link = Link()
        for i in range(9):
            for message in (
                messages.MAVLink_attitude_message(1000 * i, 0.1, 0.2, 0.3, 0, 0, 0),
                messages.MAVLink_own_thing_message(1000 * i),
            ):
                link.send(message, record_s=RECORD_EPOCH_S + i)
        path = link.save(tmp_path / "own.tlog")
        assert "OWN_THING" not in read_log(path).counts
        log = read_log(path, dialect=str(own))
        assert dict(log.counts) == {"ATTITUDE": 9, "OWN_THING": 9}
        np.testing.assert_allclose(log.attitude.time_s, np.arange(9))

    @pytest.mark.parametrize("name", ["comon", "absent.xml"])
    def test_what_is_no_dialect_is_named(self, flight, name):
        with pytest.raises(UsageError, match=f"dialect {name}"):
            read_log(flight.path, dialect=name)


class TestGimbal:
    def gimbal_log(self, tmp_path, *, flags, component=154, boot_lag_s=0.0):
        link = Link()
        fly(link, seconds=5, heading_deg=lambda t: 30.0)
        for i in range(51):
            q = rotation.ned_from_frd(*np.radians([60.0, -45.0, 0.0]))
            ms = round((100 + boot_lag_s + i / 10) * 1000)
            link.send(
                mav.MAVLink_gimbal_device_attitude_status_message(0, 0, ms, flags, q, 0, 0, 0, 0),
                record_s=RECORD_EPOCH_S + i / 10 + 0.04, component=component,
            )  # fmt: skip
        link.packets.sort(key=lambda p: p[:8])
        return read_log_of(tmp_path / "g.tlog", b"".join(link.packets))

    @pytest.mark.parametrize(("flags", "yaw"), [(32, 90.0), (64, 60.0), (16, 60.0), (12, 90.0)])
    def test_yaw_counts_from_what_the_flags_say(self, tmp_path, flags, yaw):
        log = self.gimbal_log(tmp_path, flags=flags)
        ypr = np.degrees(rotation.camera_yaw_pitch_roll(poses(log, [102.0], Mount(gimbal=True)).enu_from_cam))
        np.testing.assert_allclose(ypr[0], [yaw, -45.0, 0.0], atol=0.05)

    def test_a_gimbal_with_a_clock_of_its_own_is_brought_to_the_vehicles(self, tmp_path):
        log = self.gimbal_log(tmp_path, flags=32, boot_lag_s=-37.0)
        np.testing.assert_allclose(log.gimbal.time_s, 100 + np.arange(51) / 10, atol=0.05)

    def mount_log(self, tmp_path, angles):
        """A vehicle that rocks by 10 degrees; `angles` gives mount pitch and roll from its pitch and roll."""
        link = Link()
        for i in range(200):
            t, now, ms = i / 10, RECORD_EPOCH_S + i / 10, round((100 + i / 10) * 1000)
            roll, pitch = 10 * np.sin(t), 10 * np.cos(1.3 * t)
            link.send(mav.MAVLink_attitude_message(ms, *np.radians([roll, pitch, 0.0]), 0, 0, 0), record_s=now)
            a, b = angles(pitch, roll)
            link.send(mav.MAVLink_mount_status_message(0, 0, round(a * 100), round(b * 100), 0, 0), record_s=now)
        return read_log(link.save(tmp_path / "m.tlog"))

    def test_servo_angles_are_known_by_their_motion_against_the_vehicles(self, tmp_path):
        assert self.mount_log(tmp_path, lambda pitch, roll: (-30 - pitch, -roll)).gimbal.frame[0] == BODY

    def test_stabilised_angles_are_known_by_their_rest(self, tmp_path):
        log = self.mount_log(tmp_path, lambda pitch, roll: (-30, 0))
        assert log.gimbal.frame[0] == HEADING
        assert any("does not say" in note for note in log.notes)

    def test_a_mount_of_zeros_is_none(self, tmp_path):
        log = self.mount_log(tmp_path, lambda pitch, roll: (0, 0))
        assert log.gimbal is None
        with pytest.raises(InputFileError, match="no mount is attached"):
            poses(log_with_place(log), [105.0], Mount(gimbal=True))


def log_with_place(log):
    from dataclasses import replace

    from tests.scenes.logs import log_of

    return replace(log, position=log_of(time_s=(104.0, 105.0, 106.0)).position)


class TestStart:
    def test_a_number_is_log_time(self, flight):
        assert resolve_start(flight, 104.5, where="w") == 104.5

    def test_a_large_number_is_the_recorders_posix_time(self, flight):
        assert resolve_start(flight, RECORD_EPOCH_S + 5.03, where="w") == pytest.approx(105.0, abs=1e-3)

    @pytest.mark.parametrize("zone", ["Z", "+00:00", ""])
    def test_a_utc_time_needs_no_zone(self, flight, zone):
        assert resolve_start(flight, f"2023-11-14T21:58:25.500{zone}", where="w") == pytest.approx(105.5, abs=1e-3)

    def test_another_zone_is_heeded(self, flight):
        assert resolve_start(flight, "2023-11-15T05:58:25+08:00", where="w") == pytest.approx(105.0, abs=1e-3)

    def test_utc_of_log_time(self, flight):
        assert utc_at(flight, 105.0) == pytest.approx(BOOT_UTC_S + 105.0, abs=1e-3)

    def test_without_utc_the_message_is_named(self, tmp_path):
        log = read_log(tlog(tmp_path / "n.tlog", utc=False))
        assert utc_at(log, 105.0) is None
        with pytest.raises(InputFileError, match=r"w: n.tlog does not know UTC; expected SYSTEM_TIME"):
            resolve_start(log, "2023-11-14T21:58:25Z", where="w")

    def test_camera_events(self, tmp_path, flight):
        with pytest.raises(InputFileError, match="CAMERA_IMAGE_CAPTURED"):
            resolve_start(flight, "camera-event", where="w")
        link = Link()
        fly(link, seconds=5)
        for i, result in enumerate((0, 1, 1)):
            event = mav.MAVLink_camera_image_captured_message
            link.send(
                event(round((102 + i) * 1000), 0, 0, 0, 0, 0, 0, [1, 0, 0, 0], i, result, b""),
                record_s=RECORD_EPOCH_S + 2.05 + i, component=100,
            )  # fmt: skip
        link.packets.sort(key=lambda p: p[:8])
        log = read_log_of(tmp_path / "c.tlog", b"".join(link.packets))
        assert resolve_start(log, "camera-event", where="w") == pytest.approx(103.0, abs=1e-6)
        assert log.camera_event_source == "CAMERA_IMAGE_CAPTURED"

    def test_events_one_for_each_frame_are_the_frames_times(self, onboard):
        """The log has an event every second from 100 s on."""
        frame = np.array([0, 2, 3, 7])
        np.testing.assert_allclose(event_times(onboard, frame, frame * 1.03), 100.0 + frame)

    def test_events_that_are_no_frames_are_not(self, onboard):
        frame = np.arange(5)
        assert event_times(onboard, frame, frame * 0.04) is None  # 25 Hz: the events are something else
        assert event_times(onboard, np.arange(12), np.arange(12.0)) is None  # one too few
        assert event_times(onboard, frame[:1], frame[:1] * 1.0) is None

    @pytest.mark.parametrize("start", ["soon", "12:30", float("nan"), float("inf")])
    def test_what_is_no_time_is_a_usage_error(self, flight, start):
        with pytest.raises(UsageError, match="w: start ="):
            resolve_start(flight, start, where="w")

    def test_an_onboard_log_has_no_recorder(self, onboard):
        with pytest.raises(InputFileError, match="no recorder's clock"):
            resolve_start(onboard, 1.7e9, where="w")


class TestDataflash:
    def test_the_flight_comes_back_on_boot_time(self, onboard):
        track = poses(onboard, [100.0, 101.05, 109.99])
        np.testing.assert_allclose(track.position_enu_m[:, 0], [0.0, 10.5, 99.9], atol=0.02)
        ypr = np.degrees(rotation.camera_yaw_pitch_roll(track.enu_from_cam))
        np.testing.assert_allclose(ypr, [[90 + 3 * t, -1.15, 0.57] for t in (0.0, 1.05, 9.99)], atol=0.02)
        assert (onboard.position.source, onboard.attitude.source) == ("POS", "ATT")

    def test_utc_is_gps_time_less_leap_seconds(self, onboard):
        week = 315_964_800 + 2300 * 604_800 + 100 - 18
        assert utc_at(onboard, 105.0) == pytest.approx(week + 5.0, abs=1e-3)

    def test_camera_events_are_cam(self, onboard):
        np.testing.assert_allclose(onboard.camera_event_s, 100 + np.arange(11))

    def test_what_is_no_message_is_counted(self, tmp_path):
        found = dataflash_records()
        found[200:200] = [b"\x00" * 37]
        found[400] = found[400][:20]
        log = read_log_of(tmp_path / "broken.bin", b"".join(found))
        assert log.corrupt_packets == 2
        assert sum(log.counts.values()) == len(dataflash_records()) - 1  # the cut one

    def test_a_file_of_something_else_is_refused(self, tmp_path):
        with pytest.raises(InputFileError, match="no message definition"):
            read_log_of(tmp_path / "noise.bin", bytes(range(256)) * 20)

    def test_text_says_the_same(self, tmp_path, onboard):
        lines = ["FMT, 132, 31, POS, QLLfff, TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"]
        lines += ["FMT, 131, 27, ATT, QccccCCCC, TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"]
        for i, t in enumerate(onboard.position.time_s):
            lat, lon = np.degrees(onboard.position.lat_rad[i]), np.degrees(onboard.position.lon_rad[i])
            lines.append(f"POS, {round(t * 1e6)}, {lat:.7f}, {lon:.7f}, 100, 0, 0")
            lines.append(f"ATT, {round(t * 1e6)}, 0, 0.57, 0, -1.15, 0, {90 + 3 * (t - 100):.2f}, 0, 0")
        lines.insert(50, "ATT, 12")
        path = tmp_path / "a.log"
        path.write_text("\n".join(lines))
        log = dataflash_flight(read_dataflash_text(path))
        assert log.corrupt_packets == 1
        np.testing.assert_allclose(log.position.lon_rad, onboard.position.lon_rad, atol=1e-12)
        np.testing.assert_allclose(log.attitude.ned_from_body, onboard.attitude.ned_from_body, atol=1e-9)


@pytest.mark.parametrize("name", ["absent.tlog", "absent.bin", "absent.ulg"])
def test_a_missing_file_is_named(tmp_path, name):
    with pytest.raises(InputFileError, match=name + ": no such file"):
        read_log(tmp_path / name)


def test_files_that_are_no_logs(tmp_path):
    with pytest.raises(InputFileError, match="an empty file"):
        read_log_of(tmp_path / "empty.tlog", b"")
    with pytest.raises(InputFileError, match=r"named .xyz"):
        read_log_of(tmp_path / "a.xyz", b"hello")
    with pytest.raises(InputFileError, match="cannot be read as a PX4 log"):
        read_log_of(tmp_path / "a.ulg", b"ULog" + b"\xff" * 200)
    words = struct.pack("<HB6s", 6, ord("I"), b"\x01a1234") * 3000
    circle = struct.pack("<HB5x", 12000, 1)  # longer than what is left: pyulog alone never ends
    with pytest.raises(InputFileError, match="leads back to where it was read"):
        read_log_of(tmp_path / "b.ulg", b"ULog\x01\x12\x35\x01" + bytes(8) + words + circle)
    with pytest.raises(InputFileError, match="no position, attitude or heartbeat"):
        read_log_of(tmp_path / "noise.tlog", struct.pack(">Q", 5) + b"\xfe" * 5000)
