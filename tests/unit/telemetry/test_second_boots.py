"""A second boot in one file whose clock falls back by little, and what only looks like one."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from pipeline.telemetry import read_log
from pipeline.telemetry.clocks.boot_clock import restarts_of
from tests.scenes.logs import KINDS, RECORD_EPOCH_S, Link, dataflash_records, definitions, fly, ulog


def flown(path, *, second_boot_s, again_s, stamped=True):
    """Ten seconds from boot time 100 s on, then ten more from `second_boot_s` on, `again_s` after the first began."""
    link = Link(stamped=stamped)
    fly(link, seconds=10, boot_s=100.0)
    fly(link, seconds=10, boot_s=second_boot_s, record_s=RECORD_EPOCH_S + again_s)
    return read_log(link.save(path))


def anew(log):
    return [note for note in log.notes if "started anew" in note]


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
