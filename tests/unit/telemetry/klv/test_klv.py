"""ST 0601 in transport streams: the standard's own numbers, what is no measurement, and when the video began."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError
from pipeline.geometry import rotation
from pipeline.telemetry import Mount, camera_poses, first_position, log_span, read_log, resolve_start, utc_at
from pipeline.telemetry.heights.egm96 import geoid_height_m
from pipeline.telemetry.klv import items
from pipeline.telemetry.klv.local_set import local_sets
from tests.scenes.klv import ERRORS, KEY, STANDARDS_EXAMPLE, VIDEO_PID, Part, at_place, flight, local_set, transport

STAMP_S = 1_700_000_000.0


def sets(many=30, **more):
    """A platform that flies east at 10 Hz."""
    return [local_set(at_place(STAMP_S + i / 10, lon=112.9 + 1e-5 * i, **more)) for i in range(many)]


def read(tmp_path, parts, **how):
    return read_log(transport(tmp_path / "a.ts", parts, **how))


class TestTheStandardsNumbers:
    """ST 0601's example values, to the resolution that it states."""

    @pytest.mark.parametrize(
        ("item", "packed", "value", "within"),
        [
            (2, "000459F4A6AA4AA8", 1224807209.913, 1e-6),
            (5, "71C2", 159.9744, 5.5e-3),
            (6, "FD3D", -0.4315251, 6.2e-4),
            (7, "08B8", 3.405814, 1.6e-3),
            (13, "5595B66D", 60.1768229669783, 4.3e-8),
            (14, "5B5360C4", 128.426759042045, 8.4e-8),
            (15, "C221", 14190.72, 0.31),
            (16, "CD9C", 144.5713, 2.8e-3),
            (17, "D917", 152.6436, 2.8e-3),
            (18, "724A0A20", 160.719211474396, 8.4e-8),
            (19, "87F84B86", -168.792324833941, 8.4e-8),
            (20, "7DC55ECE", 176.865437690572, 8.4e-8),
            (75, "C221", 14190.72, 0.31),
            (90, "FF62E2F2", -0.43152510208614414, 4.3e-8),
            (91, "04D80CDF", 3.405814, 1.7e-4),
            (104, "2F921E", 23456.24, 7.9e-3),
        ],
    )
    def test_one_item(self, item, packed, value, within):
        assert items.ITEMS[item](bytes.fromhex(packed)) == pytest.approx(value, abs=within)

    def test_a_whole_packet(self):
        found = local_sets(STANDARDS_EXAMPLE)
        assert (len(found.sets), found.corrupt, found.unchecked) == (1, 0, 0)
        one = found.sets[0].items
        assert (one[3], one[10], one[11]) == (b"Mission 12", b"Predator", b"EO Nose")
        assert items.ITEMS[13](one[13]) == pytest.approx(60.176822966978335)
        assert items.ITEMS[2](one[2]) == pytest.approx(1231798102.0)

    @pytest.mark.parametrize("at", [17, 40, 100, len(STANDARDS_EXAMPLE) - 1])
    def test_any_other_byte_breaks_it(self, at):
        wrong = bytearray(STANDARDS_EXAMPLE)
        wrong[at] ^= 0x04
        found = local_sets(bytes(wrong))
        assert (len(found.sets), found.corrupt) == (0, 1)

    @pytest.mark.parametrize("item", sorted(ERRORS))
    def test_an_error_value_is_none(self, item):
        assert np.isnan(items.ITEMS[item](ERRORS[item]))

    @pytest.mark.parametrize("packed", ["", "C8", "E80000", "900000", "D00001"])
    def test_special_values_of_imapb_are_none(self, packed):
        """ST 1201: infinities, no number, and values out of range have the top bit."""
        assert np.isnan(items.ITEMS[104](bytes.fromhex(packed)))


class TestWholeStreams:
    @pytest.mark.parametrize(("kind", "sigma"), [(0x06, 0.2), (0x15, 0.02)])
    @pytest.mark.parametrize("stride", [188, 192, 204])
    def test_positions_attitudes_and_the_videos_start(self, tmp_path, kind, sigma, stride):
        log = read(tmp_path, flight(sets(), kind=kind), kinds={VIDEO_PID: 0x1B, 0x102: kind}, stride=stride)
        assert (log.format, log.corrupt_packets, dict(log.counts)) == ("misb klv", 0, {"ST 0601": 30})
        assert np.degrees(log.position.lon_rad) == pytest.approx(112.9 + 1e-5 * np.arange(30), abs=1e-7)
        assert log.position.height_m == pytest.approx(100.0, abs=0.01)
        assert log.position.time_s == pytest.approx(STAMP_S + np.arange(30) / 10, abs=1e-5)
        assert (log.video_start_s, log.video_start_sigma_s) == (pytest.approx(STAMP_S, abs=1e-4), sigma)
        assert utc_at(log, STAMP_S) == pytest.approx(STAMP_S)
        poses = camera_poses(
            log, camera="c", frame=np.array([5]), log_time_s=np.array([STAMP_S + 0.5]), mount=Mount(gimbal=True),
            lever_arm_m=np.zeros(3), origin=first_position(log), where="w",
        )  # fmt: skip
        facing = np.degrees(rotation.camera_yaw_pitch_roll(poses.enu_from_cam))[0]
        assert facing == pytest.approx([90, -30, 0], abs=0.01)

    def test_a_clock_of_33_bits_that_begins_anew(self, tmp_path):
        log = read(tmp_path, flight(sets(), first_pts_s=(1 << 33) / 90_000 - 1.0))
        assert log.video_start_s == pytest.approx(STAMP_S, abs=1e-3)

    def test_metadata_that_lags_moves_the_start(self, tmp_path):
        log = read(tmp_path, flight(sets(), late_s=0.4))
        assert log.video_start_s == pytest.approx(STAMP_S - 0.4, abs=1e-3)

    def test_a_video_that_begins_amid_a_group_counts_from_its_first_key_frame(self, tmp_path):
        parts = flight(sets())
        parts[0] = Part(pid=VIDEO_PID, content=b"frame", pts_s=10.0, stream=0xE0)
        parts[4] = Part(pid=VIDEO_PID, content=b"frame", pts_s=10.2, stream=0xE0, key_frame=True)
        assert read(tmp_path, parts).video_start_s == pytest.approx(STAMP_S + 0.2, abs=1e-3)

    def test_metadata_without_a_time_stands_beside_the_frame_before(self, tmp_path):
        log = read(tmp_path, flight(sets(), stamped=False))
        assert (log.video_start_s, log.video_start_sigma_s) == (pytest.approx(STAMP_S, abs=1e-3), 0.5)

    def test_a_set_over_several_parts(self, tmp_path):
        content = b"".join(sets())
        parts = [Part(pid=VIDEO_PID, content=b"f", pts_s=10.0, stream=0xE0, key_frame=True)]
        parts += [Part(pid=0x102, content=content[i : i + 70], pts_s=10.0) for i in range(0, len(content), 70)]
        assert len(read(tmp_path, parts).position.time_s) == 30

    def test_lost_and_bent_packets_cost_their_own_sets(self, tmp_path):
        path = transport(tmp_path / "a.ts", flight(sets()))
        raw = bytearray(path.read_bytes())
        raw[188 * 20 + 100] ^= 0xFF
        del raw[188 * 40 + 5 : 188 * 40 + 60]
        path.write_bytes(raw)
        log = read_log(path)
        assert len(log.position.time_s) >= 27
        assert log.corrupt_packets >= 1
        steps = np.diff(np.degrees(log.position.lon_rad)) / 1e-5
        assert steps == pytest.approx(np.round(steps), abs=0.05)

    def test_rubbish_before_the_first_packet(self, tmp_path):
        assert len(read(tmp_path, flight(sets()), lead=b"\1" * 57).position.time_s) == 30

    def test_without_metadata_it_is_said(self, tmp_path):
        parts = [Part(pid=VIDEO_PID, content=b"f" * 500, pts_s=float(i), stream=0xE0) for i in range(5)]
        with pytest.raises(InputFileError) as raised:
            read(tmp_path, parts)
        assert "without metadata" in raised.value.seen


class TestWhatIsNoMeasurement:
    def test_error_values(self, tmp_path):
        """Ten of thirty places are errors, by the standard's own value for it."""
        wrong = [{13: ERRORS[13]} if 10 <= i < 20 else {} for i in range(30)]
        found = [local_set(at_place(STAMP_S + i / 10, lon=112.9 + 1e-5 * i) | wrong[i]) for i in range(30)]
        log = read(tmp_path, flight(found))
        assert int(log.position.valid.sum()) == 20
        assert any("10 of 30 positions" in note and "not used" in note for note in log.notes)

    def test_pitch_out_of_its_range_is_read_where_it_is_full(self, tmp_path):
        """Item 6 ends at 20 degrees and says so; item 90 goes on."""
        steep = {**at_place(STAMP_S), 6: ERRORS[6], 90: 35.0}
        narrow = {2: STAMP_S + 0.1, 5: 90.0, 6: 5.0, 7: 1.0}
        lost = {2: STAMP_S + 0.2, 5: 90.0, 6: ERRORS[6], 7: 1.0}
        log = read(tmp_path, flight([local_set(s) for s in (steep, narrow, lost)]))
        pitch = np.degrees(rotation.yaw_pitch_roll(log.attitude.ned_from_body)[:, 1])
        assert pitch[:2] == pytest.approx([35, 5], abs=1e-3)
        assert np.isnan(pitch[2])

    def test_sets_without_a_checksum_are_said(self, tmp_path):
        log = read(tmp_path, flight([local_set(at_place(STAMP_S + i / 10), checked=False) for i in range(5)]))
        assert any("5 metadata sets carry no checksum" in note for note in log.notes)


class TestHeights:
    def above(self, tmp_path, **heights):
        found = []
        for i in range(20):
            values = at_place(STAMP_S + i / 10, lon=112.9 + 1e-5 * i)
            del values[104]
            found.append(local_set(values | {int(name[1:]): value for name, value in heights.items()}))
        return read(tmp_path, flight(found))

    def test_above_mean_sea_level(self, tmp_path):
        log = self.above(tmp_path, _15=200.0)
        undulation = geoid_height_m(np.radians([28.2]), np.radians([112.9]))[0]
        assert log.position.height_m == pytest.approx(200.0 + undulation, abs=0.2)
        assert "EGM96" in log.position.height_from

    @pytest.mark.parametrize("item", ["_75", "_104"])
    def test_above_the_ellipsoid(self, tmp_path, item):
        log = self.above(tmp_path, **{item: 200.0})
        assert log.position.height_m == pytest.approx(200.0, abs=0.16)
        assert "ellipsoid" in log.position.height_from

    @pytest.mark.parametrize("item", ["_75", "_104"])
    def test_one_height_in_both_is_said(self, tmp_path, item):
        log = self.above(tmp_path, _15=200.0, **{item: 200.0})
        assert any("it says nothing" in note for note in log.notes)
        assert log.position.height_m[0] < 190

    def test_far_from_egm96_is_said(self, tmp_path):
        log = self.above(tmp_path, _15=200.0, _104=230.0)
        assert any("apart; the log's own is used" in note for note in log.notes)
        assert log.position.height_m == pytest.approx(230.0, abs=0.2)


TWO_STREAMS = {VIDEO_PID: 0x1B, 0x102: 0x06, 0x103: 0x06}


class TestWhoseStream:
    def two(self, other_lon, **how):
        first = flight(sets())
        second = [local_set(at_place(STAMP_S + i / 10, lon=other_lon + 1e-5 * i)) for i in range(30)]
        return [*first, *[p for p in flight(second, pid=0x103) if p.pid == 0x103]]

    def test_two_sensors_are_two_vehicles(self, tmp_path):
        path = transport(tmp_path / "a.ts", self.two(113.1), kinds=TWO_STREAMS)
        log = read_log(path)
        assert (log.systems, log.system) == ((1, 2), 1)
        assert np.degrees(read_log(path, system=2).position.lon_rad[0]) == pytest.approx(113.1, abs=1e-6)
        assert read_log(path, system=2).system == 2

    def test_one_sensor_told_twice_is_one(self, tmp_path):
        assert read(tmp_path, self.two(112.9), kinds=TWO_STREAMS).systems == ()

    def test_a_picture_from_another_sensor_is_said(self, tmp_path):
        found = [local_set(at_place(STAMP_S + i / 10) | {11: "EO" if i < 15 else "IR"}) for i in range(30)]
        assert any("from EO to IR" in note for note in read(tmp_path, flight(found)).notes)


class TestClocks:
    def test_leap_seconds(self, tmp_path):
        """Item 136 is added to the time stamp: UTC."""
        log = read(tmp_path, flight(sets(_136=-28.0)))
        assert utc_at(log, STAMP_S) == pytest.approx(STAMP_S - 28)
        assert log.video_start_s == pytest.approx(STAMP_S, abs=1e-3)
        assert resolve_start(log, "2023-11-14T22:12:53Z", where="w") == pytest.approx(STAMP_S + 1, abs=1e-3)

    @pytest.mark.parametrize(("later_s", "begin_s"), [(50.0, 1.7e9 + 50.0), (-5000.0, None)])
    def test_two_recordings_in_one_file(self, tmp_path, later_s, begin_s):
        """The second one's sets do not come among the first's: log time goes on by the time stamps where they do."""
        parts = []
        for late in (0.0, later_s):
            sets = [local_set(at_place(1.7e9 + late + i / 10, lon=112.9 + 1.01e-5 * i)) for i in range(60)]
            parts.append(transport(tmp_path / "part.ts", flight(sets)).read_bytes())
        (tmp_path / "a.ts").write_bytes(b"".join(parts))
        log = read_log(tmp_path / "a.ts")
        assert (np.diff(log.position.lon_rad) < 0).sum() == 1
        assert begin_s is None or log.position.time_s[60] == pytest.approx(begin_s)
        assert any("another recording begins" in note for note in log.notes)

    def test_places_renewed_five_times_a_second(self, tmp_path):
        sets = [local_set(at_place(1.7e9 + i / 25, lon=112.9 + 2.02e-5 * (i // 5))) for i in range(200)]
        log = read_log(transport(tmp_path / "a.ts", flight(sets)))
        assert int(log.position.valid.sum()) == 40
        assert any("renewed at 5.0 Hz" in note for note in log.notes)

    def test_a_clock_that_was_set_on_the_way(self, tmp_path):
        """An hour wrong for the first half: the video's own time does not jump."""
        found = [local_set(at_place(STAMP_S + i / 10 - 3600 * (i < 15), lon=112.9 + 1e-5 * i)) for i in range(30)]
        log = read(tmp_path, flight(found))
        assert log_span(log) == pytest.approx((0.0, 2.9), abs=1e-3)
        assert any("jump against the video" in note for note in log.notes)
        assert utc_at(log, 0.0) == pytest.approx(STAMP_S, abs=0.01)

    def test_without_time_stamps(self, tmp_path):
        found = [local_set({k: v for k, v in at_place(0.0, lon=112.9 + 1e-5 * i).items() if k != 2}) for i in range(30)]
        log = read(tmp_path, flight(found))
        assert log_span(log) == pytest.approx((0.0, 2.9), abs=1e-3)
        assert (log.video_start_s, log.utc) == (0.0, None)


def test_a_key_alone_is_nothing():
    assert local_sets(KEY).corrupt == 1
    assert local_sets(b"").sets == ()
