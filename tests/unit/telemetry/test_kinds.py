"""What can be wrong with a log, kind by kind, in every format: where each cell is tested, or why it has no log.

`pytest -s tests/unit/telemetry/test_kinds.py -k printed` prints the table. A cell names tests, each of which packs its
log by hand and names its source in its own words; those of old DataFlash firmware and the cells that no other module
has are here. Sources: [MAV] MAVLink's message definitions, [AP] ArduPilot's log messages, [PX4] its message files,
[MISB] ST 0601, ST 1201, ST 1402, [DJI] subtitles and flight records as public samples have them.
"""

from __future__ import annotations

import ast
import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.geometry import rotation
from pipeline.telemetry import inspect_log, log_sigma, read_log, utc_at
from pipeline.telemetry.heights.egm96 import geoid_height_m
from tests.scenes.logs import PLACE

HERE = Path(__file__).parent
LAT, LON = np.degrees(PLACE.lat_rad), np.degrees(PLACE.lon_rad)
KINDS = ("ids", "validity", "frames", "heights", "sigmas", "clocks", "boots", "definitions")
FORMATS = ("tlog", "DataFlash old", "DataFlash new", "ULog", "SRT", "KLV", "CSV")
MORE, LOGS, KLV, CSV = (
    "test_kinds_by_format.py",
    "test_logs.py",
    "klv/test_klv.py",
    "flight_records/test_flight_records.py",
)
IDS = "test_kinds_of_ids.py"
TWICE, WHOSE = "test_second_boots.py", "test_kinds_of_receivers.py"
WORTH, OWN, SRT = "camera_pose/test_sigma_over_time.py", "test_kinds.py", "test_inspection_and_subtitles.py"

CELLS: dict[tuple[str, str], tuple[str, ...] | str] = {
    ("ids", "tlog"): (
        f"{MORE}::test_an_autopilot_is_what_its_heartbeat_says",
        f"{MORE}::test_one_camera_of_several_is_taken",
        f"{WHOSE}::test_the_second_receiver_where_the_first_has_no_fix",
        f"{WHOSE}::test_a_gimbal_of_another_system_is_named",
    ),
    ("ids", "DataFlash old"): (
        f"{OWN}::test_old_second_receiver_is_a_message_of_its_own",
        f"{IDS}::test_the_one_in_use",
        f"{IDS}::test_one_that_takes_over_on_the_way",
        f"{IDS}::test_the_one_that_flew",
    ),
    ("ids", "DataFlash new"): (
        f"{MORE}::test_accuracy_is_that_of_the_receiver_in_use",
        f"{MORE}::test_mnt_instances",
        f"{IDS}::test_one_camera_of_several_in_dataflash",
    ),
    ("ids", "ULog"): (
        f"{MORE}::test_px4_gimbals",
        f"{IDS}::test_a_receiver_with_a_fix",
        f"{IDS}::test_the_estimator_that_was_selected",
        f"{IDS}::test_one_camera_of_several",
    ),
    ("ids", "SRT"): "subtitles are those of one video of one vehicle: nothing in them tells another",
    ("ids", "KLV"): (f"{KLV}::test_two_sensors_are_two_vehicles", f"{KLV}::test_a_picture_from_another_sensor_is_said"),
    ("ids", "CSV"): "a record is of one vehicle with one camera: no column tells another",
    ("validity", "tlog"): (
        f"{MORE}::test_gps_without_a_fix_is_no_position",
        f"{MORE}::test_angles_under_an_encoder_error_are_none",
    ),
    ("validity", "DataFlash old"): (f"{OWN}::test_old_status",),
    ("validity", "DataFlash new"): (f"{MORE}::test_dataflash_gps_without_a_fix_is_none",),
    ("validity", "ULog"): (f"{MORE}::test_px4_flags", f"{IDS}::test_dead_reckoning_is_said"),
    ("validity", "SRT"): (f"{OWN}::test_subtitles_at_0_0",),
    ("validity", "KLV"): (f"{KLV}::test_error_values", f"{KLV}::test_an_error_value_is_none"),
    ("validity", "CSV"): (
        f"{CSV}::test_0_0_is_no_place",
        f"{CSV}::test_a_decoder_that_writes_metres_and_utc_and_says_neither",
    ),
    ("frames", "tlog"): (
        f"{MORE}::test_a_servo_gimbal_that_flags_a_lock",
        f"{MORE}::test_yaw_is_held_against_the_heading",
        f"{MORE}::test_servos_whose_flags_change_on_the_way",
        f"{MORE}::test_px4_s_own_outputs",
    ),
    ("frames", "DataFlash old"): (f"{OWN}::test_old_mount_does_not_say_what_it_counts_from",),
    ("frames", "DataFlash new"): (f"{MORE}::test_mnt_of_servos", f"{MORE}::test_mnt_that_never_moves"),
    ("frames", "ULog"): (
        f"{MORE}::test_px4_flags_of_servos",
        f"{MORE}::test_px4_s_own_outputs",
        f"{MORE}::test_a_gimbal_s_own_yaw_lock_is_believed",
    ),
    ("frames", "SRT"): (f"{SRT}::test_gimbal_angles_are_pitch_roll_yaw",),
    ("frames", "KLV"): (
        f"{KLV}::test_positions_attitudes_and_the_videos_start",
        f"{OWN}::test_klv_sensor_angles_are_against_a_banking_body",
    ),
    ("frames", "CSV"): (f"{CSV}::test_airdata", f"{OWN}::test_csv_gimbal_counts_from_the_horizon_of_a_banking_body"),
    ("heights", "tlog"): (
        f"{MORE}::test_a_log_s_own_undulation_is_held_against_egm96",
        f"{MORE}::test_a_parameter_that_changes_what_heights_mean",
    ),
    ("heights", "DataFlash old"): (f"{OWN}::test_old_heights",),
    ("heights", "DataFlash new"): (f"{MORE}::test_dataflash_equal_heights",),
    ("heights", "ULog"): (f"{MORE}::test_px4_equal_heights",),
    ("heights", "SRT"): (f"{MORE}::test_a_take_off_where_no_land_is",),
    ("heights", "KLV"): (f"{KLV}::test_one_height_in_both_is_said", f"{KLV}::test_above_mean_sea_level"),
    ("heights", "CSV"): (
        f"{CSV}::test_heights_above_the_takeoff_need_one",
        f"{CSV}::test_a_height_without_a_known_unit_is_refused",
    ),
    ("sigmas", "tlog"): (f"{LOGS}::test_sigmas_come_from_the_receiver", f"{WORTH}::test_a_fix_that_is_lost_on_the_way"),
    ("sigmas", "DataFlash old"): (f"{OWN}::test_old_fix_without_accuracy",),
    ("sigmas", "DataFlash new"): (f"{WORTH}::test_a_fix_that_is_lost_on_the_way",),
    ("sigmas", "ULog"): (f"{WORTH}::test_a_fix_that_is_lost_on_the_way",),
    ("sigmas", "SRT"): (f"{MORE}::test_digits_are_part_of_the_sigma", f"{MORE}::test_a_staircase_is_a_sample_a_step"),
    ("sigmas", "KLV"): (f"{OWN}::test_klv_states_no_accuracy", f"{KLV}::test_places_renewed_five_times_a_second"),
    ("sigmas", "CSV"): (f"{CSV}::test_airdata", f"{CSV}::test_places_renewed_twice_a_second_are_a_sample_a_step"),
    ("clocks", "tlog"): (
        f"{MORE}::test_utc_that_was_set_on_the_way",
        f"{MORE}::test_leap_seconds_that_a_receiver_learns_late",
        f"{MORE}::test_a_week_that_rolled_over_is_told",
        f"{LOGS}::test_after_a_reboot_log_time_goes_on_by_the_recorders_clock",
    ),
    ("clocks", "DataFlash old"): (f"{OWN}::test_old_clocks",),
    ("clocks", "DataFlash new"): (
        f"{MORE}::test_a_log_that_loses_time_runs_at_its_own_rate",
        f"{MORE}::test_leap_seconds_that_a_receiver_learns_late",
        f"{MORE}::test_a_week_that_rolled_over_is_told",
        f"{MORE}::test_dataflash",
    ),
    ("clocks", "ULog"): (
        f"{MORE}::test_a_log_that_counts_from_1970",
        f"{MORE}::test_when_a_px4_vehicle_started",
        f"{MORE}::test_leap_seconds_that_a_receiver_learns_late",
        f"{MORE}::test_a_week_that_rolled_over_is_told",
    ),
    ("clocks", "SRT"): (f"{MORE}::test_subtitles",),
    ("clocks", "KLV"): (f"{KLV}::test_a_clock_that_was_set_on_the_way", f"{KLV}::test_leap_seconds"),
    ("clocks", "CSV"): (
        f"{CSV}::test_utc_of_whole_seconds_is_told_where_they_tick",
        f"{CSV}::test_past_midnight",
        f"{CSV}::test_a_clock_of_seconds_or_milliseconds",
    ),
    ("boots", "tlog"): (
        f"{LOGS}::test_after_a_reboot_log_time_goes_on_by_the_recorders_clock",
        f"{TWICE}::test_a_tlog_tells_by_the_recorders_clock",
        f"{TWICE}::test_packets_that_come_late_over_another_link_are_no_boot",
    ),
    ("boots", "DataFlash old"): (f"{OWN}::test_old_firmware_that_starts_anew",),
    ("boots", "DataFlash new"): (f"{MORE}::test_dataflash", f"{TWICE}::test_dataflash"),
    ("boots", "ULog"): (f"{MORE}::test_px4", f"{TWICE}::test_px4_also_in_topics_that_come_once_a_second"),
    ("boots", "SRT"): (f"{MORE}::test_subtitles",),
    ("boots", "KLV"): (f"{KLV}::test_two_recordings_in_one_file",),
    ("boots", "CSV"): (f"{CSV}::test_two_recordings_are_two_flights",),
    ("definitions", "tlog"): (f"{LOGS}::test_a_file_of_definitions_adds_the_users_messages",),
    ("definitions", "DataFlash old"): (f"{OWN}::test_old_clocks", f"{OWN}::test_old_heights"),
    ("definitions", "DataFlash new"): (
        f"{MORE}::test_a_declared_length_is_stepped_over",
        f"{MORE}::test_a_later_definition_holds_for_later_messages",
        f"{MORE}::test_a_flipped_bit_in_a_field_s_name_or_behind_it_costs_nothing_else",
        f"{MORE}::test_a_definition_that_is_lost_costs_no_other_messages",
    ),
    ("definitions", "ULog"): (f"{OWN}::test_px4_fields_of_old_and_new_firmware",),
    ("definitions", "SRT"): (f"{MORE}::test_dialects_of_subtitles",),
    ("definitions", "KLV"): (
        f"{KLV}::test_one_item",
        f"{KLV}::test_any_other_byte_breaks_it",
        f"{OWN}::test_klv_of_unknown_items",
    ),
    ("definitions", "CSV"): (
        f"{CSV}::test_metres_rather_than_feet_and_the_finer_clock",
        f"{CSV}::test_cells_parted_by_something_else",
        f"{CSV}::test_an_unknown_unit_of_time_is_refused",
    ),
}


def names_in(module: str) -> set[str]:
    """The names of a module's tests."""
    tree = ast.parse((HERE / module).read_text())
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_cell_has_its_log_or_its_reason(kind, form):
    cell = CELLS[kind, form]
    if isinstance(cell, str):
        assert len(cell.split()) > 5, "a reason"
        return
    for name in cell:
        module, test = name.split("::")
        assert test in names_in(module), name


def test_the_table_is_printed():
    rows = []
    for kind in KINDS:
        counts = [CELLS[kind, form] for form in FORMATS]
        rows.append(f"{kind:12}" + "".join(f"{'none' if isinstance(c, str) else len(c):>15}" for c in counts))
    reasons = [f"{kind}, {form}: {cell}" for (kind, form), cell in CELLS.items() if isinstance(cell, str)]
    print("\n".join(["", " " * 12 + "".join(f"{form:>15}" for form in FORMATS), *rows, *reasons]))  # noqa: T201
    assert len(CELLS) == len(KINDS) * len(FORMATS)


# --- DataFlash as ArduPilot 3.0 to 3.2 wrote it

OLD = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "GPS": (130, "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "GPS2": (131, "BIHBcLLeEeefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,DSc,T"),
    "ATT": (132, "IccccCCCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "MNT": (133, "Ifff", "TimeMS,ActRoll,ActPitch,ActYaw"),
}
PACK = {"B": "B", "I": "I", "H": "H", "c": "h", "C": "H", "L": "i", "e": "i", "E": "I", "f": "f", "n": "4s", "N": "16s",
        "Z": "64s"}  # fmt: skip


def old_record(name: str, *values: float | bytes) -> bytes:
    kind, letters, _ = OLD[name]
    return b"\xa3\x95" + struct.pack("<B" + "".join(PACK[letter] for letter in letters), kind, *values)


def old_log(path, *, status=3, second=None, mount=False, lean=lambda t: 0.0, boot_ms=100_000, week_ms=107_000):
    """Ten seconds at 10 Hz: east of PLACE, boot at 100 s, week 1800, the receiver's own time 7 s into it at boot."""
    records = []
    for kind, letters, columns in OLD.values():
        length = 3 + struct.calcsize("<" + "".join(PACK[letter] for letter in letters))
        name = next(n for n, (k, _, _) in OLD.items() if k == kind)
        records.append(old_record("FMT", kind, length, name.encode(), letters.encode(), columns.encode()))
    for i in range(100):
        ms, t = boot_ms + 100 * i, i / 10
        lat, lon = round(LAT * 1e7) + 37, round(LON * 1e7) + 101 * i
        fix = status(i) if callable(status) else status
        records.append(
            old_record("GPS", fix, week_ms + 100 * i, 1800, 12, 80, lat, lon, 2000, 12000, 1000, 9000, 0.0, ms)
        )
        if second is not None:
            records.append(old_record("GPS2", 3, week_ms + 100 * i, 1800, 12, 80, *second, 99900, 0, 0, 0, 0.0, ms))
        roll, pitch = 10 * np.sin(2 * t) + lean(t), 10 * np.cos(1.7 * t)
        records.append(old_record("ATT", ms, 0, round(100 * roll), 0, round(100 * pitch), 0, 9000, 0, 0))
        if mount:
            body = rotation.ned_from_frd(*np.radians([90.0, pitch, roll]))
            level = rotation.ned_from_frd(*np.radians([90.0, -30.0, 0.0]))
            servo = np.degrees(rotation.yaw_pitch_roll(rotation.multiply(rotation.conjugate(body), level)))
            records.append(old_record("MNT", ms, servo[2], servo[1], servo[0]))
    path.write_bytes(b"".join(records))
    return read_log(path)


def test_old_second_receiver_is_a_message_of_its_own(tmp_path):
    """[AP] GPS2: another receiver, elsewhere by its own account; the first one flies."""
    log = old_log(tmp_path / "a.bin", second=(10**8, 10**8))
    assert len(log.position.time_s) == 100
    assert np.degrees(log.position.lat_rad) == pytest.approx(LAT, abs=1e-5)


def test_old_status(tmp_path):
    """[AP] GPS.Status below 3 is no 3D fix."""
    log = old_log(tmp_path / "a.bin", status=lambda i: 2 if 30 <= i < 45 else 3)
    assert int(log.position.valid.sum()) == 85
    assert any("15 of 100 positions" in note for note in log.notes)


def test_old_mount_does_not_say_what_it_counts_from(tmp_path):
    """[AP] MNT.ActRoll, ActPitch, ActYaw of a mount on servos that holds the camera level."""
    log = old_log(tmp_path / "a.bin", mount=True)
    assert any("does not say what its angles count from" in note and "body" in note for note in log.notes)


def test_old_heights(tmp_path):
    """[AP] Alt is above mean sea level, in centimetres; RelAlt above home."""
    log = old_log(tmp_path / "a.bin")
    sea = geoid_height_m(np.array([PLACE.lat_rad]), np.array([PLACE.lon_rad]))[0]
    assert log.position.height_m == pytest.approx(120.0 + sea, abs=0.1)
    assert log.position.above_home_m == pytest.approx(20.0)


@pytest.mark.parametrize(("status", "sigma"), [(3, 3.0), (6, 0.03)])
def test_old_fix_without_accuracy(tmp_path, status, sigma):
    """[AP] no GPA in old firmware: the kind of fix tells."""
    log = old_log(tmp_path / "a.bin", status=status)
    assert log_sigma(log, (101.0, 108.0)).position_bias_m == pytest.approx(sigma)


def test_old_clocks(tmp_path):
    """[AP] GPS.T is milliseconds since boot, GPS.TimeMS of the week, ATT.TimeMS since boot again."""
    log = old_log(tmp_path / "a.bin")
    assert log.position.time_s == pytest.approx(100 + np.arange(100) / 10)
    assert log.attitude.time_s == pytest.approx(100 + np.arange(100) / 10)
    assert utc_at(log, 100.0) == pytest.approx(315_964_800 + 1800 * 604_800 + 107 - 16, abs=1e-3)


def test_old_firmware_that_starts_anew(tmp_path):
    """[AP] a second boot in the file: T falls back, and log time goes on by the receiver's week, ten minutes later."""
    old_log(tmp_path / "a.bin")
    old_log(tmp_path / "b.bin", boot_ms=5_000, week_ms=707_000)
    (tmp_path / "c.bin").write_bytes((tmp_path / "a.bin").read_bytes() + (tmp_path / "b.bin").read_bytes())
    log = read_log(tmp_path / "c.bin")
    assert log.position.time_s[100:] == pytest.approx(700 + np.arange(100) / 10)
    assert any("started anew" in note and "by GPS time" in note for note in log.notes)


# --- cells that no other module has


def test_subtitles_at_0_0(tmp_path):
    """[DJI] what is written before the receiver knows anything."""
    places = ["0.0, 0.0"] * 5 + [f"41.5{i:02d}1, 2.1" for i in range(15)]
    cues = [
        "{0}\n00:00:{0:02d},000 --> 00:00:{0:02d},900\n[latitude: {1}] [longitude: {2}] [rel_alt: 5.0]\n".format(
            i, *place.split(", ")
        )
        for i, place in enumerate(places)
    ]
    (tmp_path / "a.srt").write_text("\n".join(cues))
    log = read_log(tmp_path / "a.srt")
    assert (len(log.position.time_s), int(log.position.valid.sum())) == (20, 15)


def test_klv_sensor_angles_are_against_a_banking_body(tmp_path):
    """[MISB] items 18 to 20 turn from the platform's body: azimuth, then elevation, then roll."""
    from tests.scenes.klv import at_place, flight, local_set, transport

    body = rotation.ned_from_frd(*np.radians([40.0, 12.0, 25.0]))
    camera = rotation.ned_from_frd(*np.radians([110.0, -50.0, 3.0]))
    azimuth, elevation, roll = np.degrees(rotation.yaw_pitch_roll(rotation.multiply(rotation.conjugate(body), camera)))
    turned = {5: 40.0, 90: 12.0, 91: 25.0, 18: azimuth % 360, 19: elevation, 20: roll % 360}
    sets = [local_set(at_place(1.7e9 + i / 10, lon=112.9 + 1.01e-5 * i) | turned) for i in range(20)]
    log = read_log(transport(tmp_path / "a.ts", flight(sets)))
    facing = rotation.multiply(log.attitude.ned_from_body[3], log.gimbal.attitude[3])
    assert np.degrees(rotation.yaw_pitch_roll(facing)) == pytest.approx([110.0, -50.0, 3.0], abs=0.01)


def test_klv_states_no_accuracy(tmp_path):
    """[MISB] no item here tells what a position is worth: the defaults hold, and inspection says them."""
    from tests.scenes.klv import at_place, flight, local_set, transport

    sets = [local_set(at_place(1.7e9 + i / 10, lat=28.2000037, lon=112.9000011 + 1.01e-5 * i)) for i in range(20)]
    log = read_log(transport(tmp_path / "a.ts", flight(sets)))
    assert log_sigma(log).position_bias_m == 3.0
    assert any("3.00 m constant" in line for line in inspect_log(log).words)


def test_klv_of_unknown_items(tmp_path):
    """[MISB] items that a reader does not know, and numbers of two bytes, are stepped over by their lengths."""
    from tests.scenes.klv import at_place, flight, local_set, transport

    more = {48: b"\x01\x01\x01" * 70, 143: b"\x05" * 300, 300: b"\x01"}
    sets = [local_set(more | at_place(1.7e9 + i / 10, lon=112.9 + 1.01e-5 * i)) for i in range(5)]
    log = read_log(transport(tmp_path / "a.ts", flight(sets)))
    assert (len(log.position.time_s), log.corrupt_packets) == (5, 0)


def test_csv_gimbal_counts_from_the_horizon_of_a_banking_body(tmp_path):
    """[DJI] gimbal angles do not turn with the aircraft's."""
    header = "time(millisecond),latitude,longitude,height_above_takeoff(m),compass_heading(degrees),pitch(degrees)"
    rows = [f"{100 * i},45.0,7.{i:03d}1,20,90,{10 - i},{i},100.5,-30" for i in range(20)]
    (tmp_path / "a.csv").write_text(
        "\n".join([header + ",roll(degrees),gimbal_heading(degrees),gimbal_pitch(degrees)", *rows])
    )
    log = read_log(tmp_path / "a.csv")
    assert np.degrees(rotation.yaw_pitch_roll(log.gimbal.attitude)) == pytest.approx(np.array([[100.5, -30, 0]] * 20))
    assert set(log.gimbal.frame) == {0}


@pytest.mark.parametrize("new", [True, False])
def test_px4_fields_of_old_and_new_firmware(tmp_path, new):
    """[PX4] sensor_gps: degrees and metres from 1.14 on, 1e-7 degrees and millimetres before."""
    from tests.scenes.logs import ulog

    at = [100 + i / 10 for i in range(30)]
    if new:
        fields = {"latitude_deg": "f8", "longitude_deg": "f8", "altitude_msl_m": "f8", "fix_type": "u1"}
        rows = [(LAT, LON + 1.01e-5 * i, 120.0, 3) for i in range(30)]
    else:
        fields = {"lat": "i4", "lon": "i4", "alt": "i4", "fix_type": "u1"}
        rows = [(round(LAT * 1e7), round(LON * 1e7) + 101 * i, 120_000, 3) for i in range(30)]
    found = [{"t": t, **dict(zip(fields, row, strict=True))} for t, row in zip(at, rows, strict=True)]
    position = read_log(ulog(tmp_path / "a.ulg", {"vehicle_gps_position": (fields, found)})).position
    assert np.degrees(position.lon_rad) == pytest.approx(LON + 1.01e-5 * np.arange(30), abs=1e-7)
    assert position.height_m == pytest.approx(
        120 + geoid_height_m(np.array([PLACE.lat_rad]), np.array([PLACE.lon_rad]))[0], abs=0.1
    )
