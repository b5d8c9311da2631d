"""Flight records (.csv) of AirData and of DJI's decoders: units by the header, times, heights, recordings.

Headers as in public exports: AirData's of 2022 (feet) and of a Matrice 30 (metres), and those of CsvView, PhantomHelp
and TXTlogToCSVtool.
"""

from __future__ import annotations

import numpy as np
import pytest

from calibration.foundation.errors import InputFileError, UsageError
from pipeline.flight import read_flight
from pipeline.geometry import rotation
from pipeline.stages import open_sources
from pipeline.telemetry import inspect_log, is_pose_table, log_sigma, read_log, resolve_start, utc_at, with_takeoff
from pipeline.telemetry.heights.egm96 import geoid_height_m

UTC_S = 1_644_414_968.0
"""2022-02-09 13:56:08."""
AIRDATA = (
    "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff({u}),altitude_above_seaLevel({u}),"
    "speed(mph),satellites,gpslevel, compass_heading(degrees), pitch(degrees), roll(degrees),isPhoto,isVideo,"
    "gimbal_heading(degrees),gimbal_pitch(degrees)"
)
DJI = (
    "CUSTOM.date [local],CUSTOM.updateTime [local],OSD.flyTime,OSD.flyTime [s],OSD.latitude,OSD.longitude,"
    "OSD.height [ft],OSD.height [m],OSD.altitude [ft],OSD.pitch,OSD.roll,OSD.yaw,GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw,"
    "CAMERA.isVideo"
)


def airdata(
    *,
    unit="feet",
    rows=60,
    sea=True,
    offset_s=0.35,
    video=range(20, 40),
    heading=lambda i: 90.0,
    gimbal=lambda i: 100.5,
):
    """10 Hz, flying east, the clock's seconds ticking `offset_s` before the record's."""
    metre = 1 / 0.3048 if unit == "feet" else 1.0
    lines = [AIRDATA.format(u=unit)]
    for i in range(rows):
        clock = np.datetime64("2022-02-09T13:56:08") + int((i / 10 + offset_s) // 1)
        above = f"{169.0 * metre + 20 * metre}" if sea else ""
        lines.append(
            f"{100 * i},{str(clock).replace('T', ' ')},45.0,{7.0 + 1e-5 * i:.7f},{20 * metre},{above},3.1,12,5,"
            f"{heading(i):.1f}, -2.3, -0.4,0,{int(i in video)},{gimbal(i):.1f},-30.0"
        )
    return "\n".join(lines) + "\n"


def dji(*, header=DJI, rows=30, first="10:30:28.9", date="8/29/2017"):
    lines = [header]
    hours, minutes, seconds = first.split(":")
    begin = int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    for i in range(rows):
        now = (begin + i / 10) % 86400
        clock = f"{int(now // 3600)}:{int(now // 60) % 60:02d}:{now % 60:04.1f}"
        lines.append(
            f"{date},{clock},0m {i / 10}s,{2.8 + i / 10:.1f},45.0,{7.0 + 1e-5 * i:.7f},65.6,20.0,620.1,-2.3,-0.4,90.0,"
            f"-30.0,0.0,100.5,{'Recording' if 10 <= i < 20 else ''}"
        )
    return "\n".join(lines) + "\n"


def read(tmp_path, text, name="flight.csv", encoding="utf-8"):
    (tmp_path / name).write_bytes(text.encode(encoding))
    return read_log(tmp_path / name)


@pytest.mark.parametrize("unit", ["feet", "meters"])
def test_airdata(tmp_path, unit):
    log = read(tmp_path, airdata(unit=unit))
    assert (log.format, dict(log.counts)) == ("flight record", {"airdata": 60})
    assert log.position.time_s == pytest.approx(np.arange(60) / 10)
    undulation = geoid_height_m(np.radians([45.0]), np.radians([7.0]))[0]
    assert log.position.height_m[0] == pytest.approx(189.0 + undulation, abs=1e-6)
    assert log.position.above_home_m == pytest.approx(20.0)
    assert np.degrees(rotation.yaw_pitch_roll(log.attitude.ned_from_body))[0] == pytest.approx([90, -2.3, -0.4])
    assert np.degrees(rotation.yaw_pitch_roll(log.gimbal.attitude))[0] == pytest.approx([100.5, -30, 0])
    assert any("barometer" in note for note in log.notes)
    assert log_sigma(log).position_bias_m > 30


def test_utc_of_whole_seconds_is_told_where_they_tick(tmp_path):
    log = read(tmp_path, airdata())
    assert utc_at(log, 0.0) == pytest.approx(UTC_S + 0.35, abs=0.05)
    assert log.utc.sigma_s < 0.1
    assert resolve_start(log, "2022-02-09T13:56:10.35Z", where="w") == pytest.approx(2.0, abs=0.05)


def test_a_recording_begins_where_its_flag_is_raised(tmp_path):
    log = read(tmp_path, airdata())
    assert (log.camera_event_source, log.camera_event_sigma_s) == ("isVideo", 0.3)
    assert log.camera_event_s == pytest.approx([1.95])
    assert resolve_start(log, "camera-event", where="w") == pytest.approx(1.95)


def test_recordings_before_the_record_and_several_are_told(tmp_path):
    log = read(tmp_path, airdata(video=[*range(5), *range(20, 30), *range(50, 60)]))
    assert log.camera_event_s == pytest.approx([1.95, 4.95])
    assert any("begins while a video is recorded" in note for note in log.notes)
    assert any("recordings begin at log time" in note for note in log.notes)


def test_heights_above_the_takeoff_need_one(tmp_path):
    log = read(tmp_path, airdata(sea=False))
    assert log.position.datum == "home"
    assert any(line.startswith("takeoff =") for line in inspect_log(log).flight_file)
    raised = with_takeoff(log, 300.0, above_sea=False, where="w")
    assert raised.position.height_m == pytest.approx(320.0)


def test_heights_above_the_takeoff_are_refused_beside_others(tmp_path):
    (tmp_path / "flight.csv").write_text(airdata(sea=False))
    (tmp_path / "flight.toml").write_text(
        "[flight]\norigin = { lat = 45, lon = 7, height = 250 }\n"
        '[cameras.a]\ncalibration = "a.json"\ntelemetry = "flight.csv"\nstart = 0.0\nframe_rate = 25\n'
    )
    with pytest.raises(UsageError, match="take-off place only"):
        open_sources(read_flight(tmp_path / "flight.toml"))


def test_0_0_is_no_place(tmp_path):
    """What DJI writes before its receiver knows anything."""
    lines = airdata().splitlines()
    lines[1:11] = [",".join([*line.split(",")[:2], "0", "0", *line.split(",")[4:]]) for line in lines[1:11]]
    log = read(tmp_path, "\n".join(lines))
    assert (len(log.position.time_s), int(log.position.valid.sum())) == (60, 50)


class TestDJI:
    @pytest.mark.parametrize("lead", ["", "sep=,\n"])
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
    def test_metres_rather_than_feet_and_the_finer_clock(self, tmp_path, lead, encoding):
        log = read(tmp_path, lead + dji(header=DJI + ",Ñ"), encoding=encoding)
        assert dict(log.counts) == {"dji": 30}
        assert log.position.time_s == pytest.approx(np.arange(30) / 10, abs=1e-6)
        assert log.position.above_home_m == pytest.approx(20.0)
        undulation = geoid_height_m(np.radians([45.0]), np.radians([7.0]))[0]
        assert log.position.height_m[0] == pytest.approx(620.1 * 0.3048 + undulation)
        assert log.utc is None
        assert any("local, of an unknown time zone" in note for note in log.notes)
        assert log.camera_event_s == pytest.approx([0.95], abs=1e-6)
        assert np.degrees(rotation.yaw_pitch_roll(log.gimbal.attitude))[0] == pytest.approx([100.5, -30, 0])

    @pytest.mark.parametrize("date", ["8/29/2017", "2017-08-29", ""])
    def test_past_midnight(self, tmp_path, date):
        text = dji(first="23:59:58.0", date="")
        lines = text.splitlines()
        if date:
            after = {"8/29/2017": "8/30/2017", "2017-08-29": "2017-08-30"}[date]
            lines = [lines[0], *(f"{date if i < 20 else after}{line}" for i, line in enumerate(lines[1:]))]
        log = read(tmp_path, "\n".join(lines))
        assert log.position.time_s == pytest.approx(np.arange(30) / 10, abs=1e-6)

    @pytest.mark.parametrize(
        ("stamps", "steps"),
        [
            (["2017/09/19 17:29:18.383", "2017/09/19 17:29:18.493"], [0, 0.11]),
            (["11:59:59.5 AM", "12:00:00.0 PM"], [0, 0.5]),
        ],
    )
    def test_clocks_in_one_cell_and_of_twelve_hours(self, tmp_path, stamps, steps):
        rows = [f"{stamp},27.22,-81.88,57,90" for stamp in stamps]
        log = read(
            tmp_path, "\n".join(["CUSTOM.updateTime,OSD.latitude,OSD.longitude,OSD.altitude [m],OSD.yaw", *rows])
        )
        assert log.position.time_s == pytest.approx(steps, abs=1e-6)

    def test_a_decoder_that_writes_metres_and_utc_and_says_neither(self, tmp_path):
        """dji-log-parser: CUSTOM.dateTime; OSD.isGPSUsed false is a position that no receiver holds."""
        header = (
            "CUSTOM.dateTime,OSD.flyTime,OSD.latitude,OSD.longitude,OSD.height,OSD.altitude,OSD.pitch,OSD.roll,OSD.yaw,"
            "OSD.isGPSUsed,OSD.gpsNum,GIMBAL.pitch,GIMBAL.roll,GIMBAL.yaw,CAMERA.isVideo"
        )
        rows = [
            f"2022-02-09T13:56:{8 + i / 10:06.3f}Z,{i / 10},45.0,{7 + 1e-5 * i:.7f},20,320,0,0,90,"
            f"{'false' if 10 <= i < 25 else 'true'},12,-30,0,90,false"
            for i in range(60)
        ]
        log = read(tmp_path, "\n".join([header, *rows]))
        assert utc_at(log, 0.0) == pytest.approx(UTC_S, abs=0.01)
        assert log.position.above_home_m[0] == 20.0
        assert int(log.position.valid.sum()) == 45
        assert any("15 of 60 positions" in note for note in log.notes)

    @pytest.mark.parametrize(("unit", "scale"), [("[s]", 1.0), ("[ms]", 1000.0)])
    def test_a_clock_of_seconds_or_milliseconds(self, tmp_path, unit, scale):
        rows = [f"{scale * i / 10},45.0,{7 + 1e-5 * i:.7f},20" for i in range(30)]
        log = read(tmp_path, "\n".join([f"OSD.flyTime {unit},OSD.latitude,OSD.longitude,OSD.height [m]", *rows]))
        assert log.position.time_s == pytest.approx(np.arange(30) / 10, abs=1e-6)

    def test_an_unknown_unit_of_time_is_refused(self, tmp_path):
        with pytest.raises(InputFileError, match="time in 'ticks'"):
            read(tmp_path, "OSD.flyTime [ticks],OSD.latitude,OSD.longitude,OSD.height [m]\n0,45,7,20\n1,45,7,20\n")

    def test_milliseconds_since_1970(self, tmp_path):
        rows = [f"{1000 * UTC_S + 100 * i:.0f},45.0,{7 + 1e-5 * i:.7f},20" for i in range(30)]
        header = "CUSTOM.updateTime [epoch],OSD.latitude,OSD.longitude,OSD.height [m]"
        log = read(tmp_path, "\n".join([header, *rows]))
        assert utc_at(log, 1.0) == pytest.approx(UTC_S + 1.0, abs=0.01)

    @pytest.mark.parametrize("unit", ["", " [yd]"])
    def test_a_height_without_a_known_unit_is_refused(self, tmp_path, unit):
        header = f"OSD.flyTime [s],OSD.latitude,OSD.longitude,OSD.height{unit}"
        with pytest.raises(InputFileError) as raised:
            read(tmp_path, f"{header}\n0.1,45,7,20\n0.2,45,7,20\n")
        assert "metres or feet" in raised.value.expected

    def test_a_record_without_times_is_refused(self, tmp_path):
        with pytest.raises(InputFileError, match="no row with a time"):
            read(tmp_path, "OSD.latitude,OSD.longitude\n45,7\n")


def test_two_recordings_are_two_flights(tmp_path):
    """Log time goes on by the dates; the second one's rows do not come among the first's."""
    first, second = airdata().splitlines(), airdata().replace("2022-02-09 13", "2022-02-09 14").splitlines()[1:]
    log = read(tmp_path, "\n".join([*first, *second]))
    assert log.position.time_s[60:] == pytest.approx(3600 + np.arange(60) / 10, abs=1e-3)
    assert utc_at(log, 3601.0) == pytest.approx(utc_at(log, 1.0) + 3600)
    assert any("another recording begins" in note for note in log.notes)


def test_places_renewed_twice_a_second_are_a_sample_a_step(tmp_path):
    rows = [f"{100 * i},45.0,{7 + 5e-5 * (i // 5):.7f},20" for i in range(100)]
    log = read(tmp_path, "\n".join(["time(millisecond),latitude,longitude,height_above_takeoff(meters)", *rows]))
    assert int(log.position.valid.sum()) == 20
    assert any("renewed at 2.0 Hz" in note for note in log.notes)


@pytest.mark.parametrize(("delimiter", "point"), [(";", "."), (";", ","), ("\t", ".")])
def test_cells_parted_by_something_else(tmp_path, delimiter, point):
    """As spreadsheets save it where a comma parts decimals."""
    text = "\n".join(line.replace(",", delimiter).replace(".", point) for line in airdata().splitlines())
    assert read(tmp_path, text).position.lat_rad == pytest.approx(read(tmp_path, airdata()).position.lat_rad)


def test_a_table_of_poses_is_none(tmp_path):
    (tmp_path / "poses.csv").write_text("time_s,east_m,north_m,up_m,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n")
    (tmp_path / "flight.csv").write_text(airdata())
    assert is_pose_table(tmp_path / "poses.csv")
    assert not is_pose_table(tmp_path / "flight.csv")
    assert is_pose_table(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    ("turns_deg", "follows", "said"), [(60.0, 0.0, True), (60.0, 1.0, False), (60.0, 0.01, False), (5.0, 0.0, False)]
)
def test_a_gimbal_heading_that_never_moves_while_the_aircraft_turns_is_doubted(tmp_path, turns_deg, follows, said):
    log = read(
        tmp_path,
        airdata(heading=lambda i: 90.0 + turns_deg * i / 60, gimbal=lambda i: 100.0 + follows * turns_deg * i / 60),
    )
    doubts = [note for note in log.notes if "never moves while the vehicle turns by" in note]
    assert len(doubts) == said


@pytest.mark.parametrize(("later_s", "at_s"), [(1000, 1000.0), (100, 100.0)])
def test_a_second_recording_whose_times_leap_is_told_by_its_dates(tmp_path, later_s, at_s):
    header, *rows = airdata().splitlines()
    again = []
    for row in rows:
        time, clock, *rest = row.split(",")
        clock = str(np.datetime64(clock.replace(" ", "T")) + later_s).replace("T", " ")
        again.append(",".join([str(int(time) + 100_000), clock, *rest]))
    log = read(tmp_path, "\n".join([header, *rows, *again]) + "\n")
    assert log.position.time_s[60] == pytest.approx(at_s, abs=0.6)
    assert sum("another recording begins" in note for note in log.notes) == (later_s == 1000)
