"""A second boot in one file whose clock falls back by little, and what only looks like one."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry import read_log
from pipeline.telemetry.clocks.boot_clock import restarts_of
from tests.scenes.logs import BOOT_UTC_S, KINDS, RECORD_EPOCH_S, Link, dataflash_records, definitions, fly, ulog


def flown(path, *, second_boot_s, again_s, stamped=True):
    """Ten seconds from boot time 100 s on, then ten more from `second_boot_s` on, `again_s` after the first began."""
    link = Link(stamped=stamped)
    fly(link, seconds=10, boot_s=100.0)
    fly(link, seconds=10, boot_s=second_boot_s, record_s=RECORD_EPOCH_S + again_s)
    return read_log(link.save(path))


def anew(log):
    return [note for note in log.notes if "vehicle started anew at" in note]


@pytest.mark.parametrize("back_s", [1.5, 3.0, 6.0, 9.5])
@pytest.mark.parametrize("off_s", [2.0, 40.0])
def test_a_tlog_tells_by_the_recorders_clock(tmp_path, back_s, off_s):
    log = flown(tmp_path / "a.tlog", second_boot_s=110.0 - back_s, again_s=10.0 + off_s)
    assert len(anew(log)) == 1
    assert log.position.time_s[101] == pytest.approx(110.0 + off_s, abs=0.01)
    assert np.all(np.diff(log.position.time_s) >= 0)


def test_and_again_after_a_boot_that_fell_back_far(tmp_path):
    link = Link()
    for boot_s, again_s in ((100.0, 0.0), (20.0, 30.0), (25.0, 60.0)):
        fly(link, seconds=10, boot_s=boot_s, record_s=RECORD_EPOCH_S + again_s)
    log = read_log(link.save(tmp_path / "a.tlog"))
    assert len(anew(log)) == 2
    np.testing.assert_allclose(log.position.time_s[[0, 101, 202]], [100.0, 130.0, 160.0], atol=0.01)


def test_a_capture_without_a_recorders_clock(tmp_path):
    """Its times, at another phase, go on from where the clock fell to."""
    log = flown(tmp_path / "a.mavlink", second_boot_s=105.033, again_s=0.0, stamped=False)
    assert len(anew(log)) == 1
    assert log.position.time_s[101] == pytest.approx(110.0 + 3600.0, abs=0.1)


def links(path, *, lag_s, burst, last_s=20.0, dead_s=np.inf):
    """One vehicle over two links, the second `lag_s` late and in bursts; the first breaks off at `dead_s`."""
    sent = []
    for i in range(round(10 * last_s)):
        t = i / 10
        message = mav.MAVLink_global_position_int_message(
            round((100 + t) * 1000), 282000000, 1129000000 + 900 * i, 80000, 50000, 0, 1000, 0, 9000
        )
        if t < dead_s:
            sent.append((t, message))
        sent.append((lag_s + burst * (t // burst + 1), message))
    link = Link()
    for t, message in sorted(sent, key=lambda pair: pair[0]):
        link.send(mav.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), record_s=RECORD_EPOCH_S + t)
        link.send(message, record_s=RECORD_EPOCH_S + t)
    return read_log(link.save(path))


@pytest.mark.parametrize(("lag_s", "burst"), [(1.5, 0.1), (3.0, 2.0), (6.0, 1.0)])
def test_packets_that_come_late_over_another_link_are_no_boot(tmp_path, lag_s, burst):
    assert not anew(links(tmp_path / "a.tlog", lag_s=lag_s, burst=burst))


def test_nor_are_they_where_the_punctual_link_breaks_off(tmp_path):
    assert not anew(links(tmp_path / "a.tlog", lag_s=3.0, burst=1.0, dead_s=10.0))


@pytest.mark.parametrize("back_s", [1.5, 4.0, 9.0])
@pytest.mark.parametrize("gps", [True, False])
def test_dataflash(tmp_path, back_s, gps):
    head = len(definitions())
    rows = [*dataflash_records(seconds=10), *dataflash_records(seconds=10, boot_s=110.0 - back_s)[head:]]
    path = tmp_path / "a.bin"
    path.write_bytes(b"".join(r for r in rows if gps or r[2] != KINDS["GPS"][0]))
    log = read_log(path)
    assert len(anew(log)) == 1
    assert np.all(np.diff(log.position.time_s) >= 0)


@pytest.mark.parametrize("back_s", [2.0, 5.0, 9.0])
def test_px4_also_in_topics_that_come_once_a_second(tmp_path, back_s):
    def topics(begin_s):
        times = begin_s + 0.1 * np.arange(100)
        return {
            "vehicle_attitude": [{"t": t, "q[4]": (1.0, 0.0, 0.0, 0.0)} for t in times],
            "vehicle_global_position": [{"t": t, "lat": 28.2, "lon": 112.9 + 1e-6 * i, "alt": 60.0}
                                        for i, t in enumerate(times[::10])],
        }  # fmt: skip

    fields = {
        "vehicle_attitude": {"q[4]": "q"},
        "vehicle_global_position": {"lat": "f8", "lon": "f8", "alt": "f4"},
    }
    both = topics(100.0), topics(110.0 - back_s)
    log = read_log(
        ulog(tmp_path / "a.ulg", {n: (fields[n], [*both[0][n], *both[1][n]]) for n in fields}, info={"unsorted": 1})
    )
    assert len(anew(log)) == 1
    assert log.position.time_s[10] > 109.9 + 3599.0
    assert np.all(np.diff(log.position.time_s) > 0)


@pytest.mark.parametrize(
    ("time_s", "at"),
    [
        ([10.0, 11.0, 12.0, 10.4, 11.4, 12.4, 13.4], [3]),  # once a second
        ([10.0, 11.0, 12.0, 10.6, 13.0, 14.0, 15.0], []),  # one late
        ([0.0, 0.1, 0.2, 0.3, 0.25, 0.4, 0.5], []),
    ],
)
def test_rows_in_order(time_s, at):
    assert restarts_of(np.array(time_s), 1.0).tolist() == at


# --- the second boot begins later than the first ended: no clock falls back -----------------------------------------


def later(path, *, boot_s, record_after_s, utc_after_s, utc=True, stamped=True):
    """Ten seconds from boot time 100 s on, then ten from `boot_s` on, by the recorder and UTC so long after."""
    link = Link(stamped=stamped)
    fly(link, seconds=10, boot_s=100.0, utc=utc)
    boot_utc_s = BOOT_UTC_S + 110.0 + utc_after_s - boot_s
    record_s = RECORD_EPOCH_S + 10.0 + record_after_s
    fly(link, seconds=10, boot_s=boot_s, record_s=record_s, utc=utc, boot_utc_s=boot_utc_s)
    return read_log(link.save(path))


@pytest.mark.parametrize("boot_s", [114.0, 150.0, 700.0])
@pytest.mark.parametrize("utc", [True, False])
def test_a_later_boot_in_a_tlog_is_told_by_the_recorder(tmp_path, boot_s, utc):
    log = later(tmp_path / "a.tlog", boot_s=boot_s, record_after_s=1000.0, utc_after_s=1000.0, utc=utc)
    assert len(anew(log)) == 1
    assert log.position.time_s[101] == pytest.approx(1110.0, abs=0.01)
    if utc:
        assert log.utc.other_s(1110.0) == pytest.approx(BOOT_UTC_S + 1110.0, abs=0.1)
        assert not log.utc.outliers


def test_and_by_utc_in_a_capture_without_a_recorder(tmp_path):
    log = later(tmp_path / "a.mavlink", boot_s=150.0, record_after_s=0.0, utc_after_s=1000.0, stamped=False)
    assert len(anew(log)) == 1
    assert log.position.time_s[101] == pytest.approx(1110.0, abs=0.1)


@pytest.mark.parametrize("boot_s", [114.0, 150.0, 700.0])
def test_packets_that_are_missing_are_no_boot(tmp_path, boot_s):
    gap = boot_s - 110.0
    for utc in (True, False):
        log = later(tmp_path / "a.tlog", boot_s=boot_s, record_after_s=gap, utc_after_s=gap, utc=utc)
        assert not anew(log)
        assert log.position.time_s[101] == pytest.approx(boot_s)


def test_nor_is_a_recorder_that_was_set(tmp_path):
    log = later(tmp_path / "a.tlog", boot_s=150.0, record_after_s=1000.0, utc_after_s=40.0)
    assert not anew(log)
    assert log.position.time_s[101] == pytest.approx(150.0)


def test_nor_is_utc_that_was_set_beside_a_recorder_that_goes_on(tmp_path):
    log = later(tmp_path / "a.tlog", boot_s=150.0, record_after_s=40.0, utc_after_s=1000.0)
    assert not anew(log)
    assert log.position.time_s[101] == pytest.approx(150.0)


def joined_dataflash(path, *, boot_s, week_s, gps=True, head=True):
    rows = [*dataflash_records(), *dataflash_records(boot_s=boot_s, week_s=week_s)[0 if head else len(definitions()) :]]
    path.write_bytes(b"".join(r for r in rows if gps or r[2] != KINDS["GPS"][0]))
    return read_log(path)


@pytest.mark.parametrize("boot_s", [114.0, 150.0, 700.0])
@pytest.mark.parametrize("head", [True, False])
def test_a_later_boot_in_dataflash_is_told_by_gps_time(tmp_path, boot_s, head):
    log = joined_dataflash(tmp_path / "a.bin", boot_s=boot_s, week_s=1110.0, head=head)
    assert len(anew(log)) == 1
    assert log.position.time_s[101] == pytest.approx(1110.0, abs=0.01)
    assert log.attitude.time_s[101] == pytest.approx(1110.0, abs=0.01)


def test_two_logs_of_one_boot_are_one_flight(tmp_path):
    log = joined_dataflash(tmp_path / "a.bin", boot_s=150.0, week_s=150.0)
    assert not anew(log)
    assert not [note for note in log.notes if "another log" in note]
    assert log.position.time_s[101] == pytest.approx(150.0)


def test_without_gps_the_doubt_is_said_where_definitions_are_repeated(tmp_path):
    log = joined_dataflash(tmp_path / "a.bin", boot_s=150.0, week_s=0.0, gps=False)
    assert not anew(log)
    said = [note for note in log.notes if "another log begins in the file at log time 150.0 s, 40.0 s after" in note]
    assert len(said) == 1
    assert not [n for n in joined_dataflash(tmp_path / "b.bin", boot_s=150.0, week_s=0.0, gps=False, head=False).notes
                if "another log" in n]  # fmt: skip


def test_the_same_of_dataflash_as_text(tmp_path):
    lines = []
    for boot_s in (100, 150):
        lines += [
            "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
            "FMT, 130, 31, POS, QLLffe, TimeUS,Lat,Lng,Alt",
        ]
        lines += [f"POS, {round((boot_s + i / 10) * 1e6)}, 28.2, {112.9 + 1e-6 * i}, 80.0" for i in range(100)]
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines) + "\n")
    assert (
        len([note for note in read_log(path).notes if "another log begins in the file at log time 150.0 s" in note])
        == 1
    )


PX4_FIELDS = {
    "vehicle_attitude": {"q[4]": "q"},
    "vehicle_global_position": {"lat": "f8", "lon": "f8", "alt": "f4"},
    "vehicle_gps_position": {"time_utc_usec": "u64", "fix_type": "u64"},
}


def px4(path, begin_s, utc_s):
    times = begin_s + 0.1 * np.arange(100)
    rows = {
        "vehicle_attitude": [{"t": t, "q[4]": (1.0, 0.0, 0.0, 0.0)} for t in times],
        "vehicle_global_position": [{"t": t, "lat": 28.2, "lon": 112.9 + 1e-6 * i, "alt": 60.0}
                                    for i, t in enumerate(times)],
        "vehicle_gps_position": [{"t": t, "time_utc_usec": round((utc_s + t - begin_s) * 1e6), "fix_type": 3}
                                 for t in times],
    }  # fmt: skip
    names = [name for name in PX4_FIELDS if utc_s or name != "vehicle_gps_position"]
    return ulog(path, {n: (PX4_FIELDS[n], rows[n]) for n in names}).read_bytes()


@pytest.mark.parametrize("head", [0, 16])
@pytest.mark.parametrize(
    ("begin_s", "utc_after_s", "at_s"),
    [(150.0, 1010.0, 1110.0), (150.0, 50.0, 150.0), (105.0, 1010.0, 1110.0), (105.0, 0.0, 3709.9)],
)
def test_px4_logs_that_were_joined(tmp_path, head, begin_s, utc_after_s, at_s):
    """pyulog by itself reads the first of them, or of those without a head the last, and says nothing."""
    utc_s = 1.7e9 if utc_after_s else 0.0
    first, second = (
        px4(tmp_path / "a.ulg", begin, utc_s and utc_s + late) for begin, late in ((100.0, 0.0), (begin_s, utc_after_s))
    )
    path = tmp_path / "b.ulg"
    path.write_bytes(first + second[head:])
    log = read_log(path)
    assert log.counts["vehicle_attitude"] == 200
    assert len(anew(log)) == (at_s != 150.0)
    for series in (log.position, log.attitude):
        assert len(series.time_s) == 200
        assert series.time_s[100] == pytest.approx(at_s, abs=0.2)


@pytest.mark.parametrize("head", [0, 16])
def test_px4_logs_of_which_no_receiver_tells_whether_they_are_one_boot(tmp_path, head):
    path = tmp_path / "b.ulg"
    path.write_bytes(px4(tmp_path / "a.ulg", 100.0, 0.0) + px4(tmp_path / "a.ulg", 150.0, 0.0)[head:])
    log = read_log(path)
    assert not anew(log)
    assert len([note for note in log.notes if "another log begins in the file at log time 150.0 s" in note]) == 1
